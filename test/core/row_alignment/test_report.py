"""What a report says of pairs that are aligned, off, far off, and of those that tell nothing."""
import cv2
import numpy as np
import pytest
from row_scenes import HEIGHT, SEARCH, WIDTH, pair

from svdm_core import RowAlignment
from svdm_core.row_alignment.report import Verdict, check_rectification

ALIGNED = RowAlignment.identity(WIDTH, HEIGHT)


def off(*coefficients):
    return pair('leaves', RowAlignment(coefficients, WIDTH, HEIGHT))


def rolled(rows):
    left, right = pair('leaves', ALIGNED)
    return left, np.roll(right, rows, axis=0)


@pytest.mark.parametrize(('images', 'verdict'), [
    (pair('leaves', ALIGNED), Verdict.ALIGNED), ((pair('leaves', ALIGNED)[0],) * 2, Verdict.ALIGNED),
    (off(0.2, 0, 0, 0.5, 0, 0), Verdict.SLIGHTLY_OFF), (off(1.4, 0, 0, 0, 0, 0), Verdict.OFF),
    (rolled(5), Verdict.NOT_RECTIFIED), ((np.zeros((9, 9), np.uint8),) * 2, Verdict.UNKNOWN),
    ((pair('leaves', ALIGNED)[0], pair('leaves', ALIGNED, 5)[1]), Verdict.UNKNOWN)])
def test_verdicts(images, verdict):
    report = check_rectification(images, *SEARCH)
    assert report.verdict is verdict and report.advice and '\n' not in report.advice
    assert (report.alignment is not None) == (verdict in (Verdict.SLIGHTLY_OFF, Verdict.OFF))


def test_the_figures_of_a_report():
    rows = RowAlignment((0.2, 0, 0, 0.5, 0, 0), WIDTH, HEIGHT)
    report = check_rectification([pair('leaves', rows, seed) for seed in range(2)], *SEARCH)
    assert (report.pairs, report.shape) == (2, (HEIGHT, WIDTH)) and report.points.size > 300
    places = report.places()
    assert places['centre'] == pytest.approx(0.2, abs=0.08) and places['top left'] == pytest.approx(0.7, abs=0.15)
    assert places['bottom left'] == pytest.approx(-0.3, abs=0.15) and len(places) == 5
    before, after = report.residuals
    assert after < 0.1 < 0.15 < before
    far = check_rectification(rolled(5), *SEARCH)
    assert far.residuals == pytest.approx((5, 5), abs=0.2) and set(far.places().values()) == {0}


def test_no_pair_is_refused():
    with pytest.raises(ValueError, match='there is no pair'):
        check_rectification([], *SEARCH)


def test_the_plot_has_a_row_of_its_images_shape_for_each_report_also_without_points():
    pytest.importorskip('matplotlib')
    from svdm_core.row_alignment.plot import plot_reports

    def plot(**reports):
        picture = cv2.imdecode(np.frombuffer(plot_reports(reports), np.uint8), cv2.IMREAD_COLOR)
        assert picture.shape[1] == 1100 and len(np.unique(picture)) > 20
        return picture.shape[0]

    wide = check_rectification(off(0.2, 0, 0, 0.5, 0, 0), *SEARCH)
    square = check_rectification((np.zeros((9, 9), np.uint8),) * 2, *SEARCH)
    tall = check_rectification((np.zeros((90, 30), np.uint8),) * 2, *SEARCH)
    assert plot(wide=wide) < plot(square=square) < plot(tall=tall) < plot(square=square, tall=tall)
