import numpy as np
import pytest

from svdm_core.evaluation.datasets import MIDDLEBURY_WEIGHTS
from svdm_core.evaluation.metrics import error_metrics, weighted_average

TRUTH = np.array([[10.0, 10.0, 10.0, 10.0, np.inf, 10.0]], np.float32)
ESTIMATE = np.array([[10.0, 10.5, 13.0, 5.0, 99.0, np.nan]], np.float32)


def test_metrics_of_a_map_by_hand():
    metrics = error_metrics(ESTIMATE, TRUTH)
    assert metrics['avgerr'] == pytest.approx((0 + 0.5 + 3 + 5) / 4)
    assert metrics['rms'] == pytest.approx(np.sqrt((0.25 + 9 + 25) / 4))
    # five pixels are known; the one without an answer is bad at any threshold
    assert [metrics[f'bad{t}'] for t in ('0.5', '1', '2', '4')] == pytest.approx([60, 60, 60, 40])
    assert metrics['density'] == pytest.approx(80)
    assert metrics['a50'] == pytest.approx(1.75) and metrics['a99'] == pytest.approx(np.percentile([0, 0.5, 3, 5], 99))


def test_scale_and_mask():
    mask = np.array([[1, 1, 0, 0, 1, 0]], bool)
    metrics = error_metrics(ESTIMATE, TRUTH, mask, scale=4.0)
    assert metrics['avgerr'] == pytest.approx(1.0) and metrics['bad1'] == pytest.approx(50)


def test_nothing_known_is_nan_and_shapes_must_agree():
    assert np.isnan(list(error_metrics(ESTIMATE, np.full_like(TRUTH, np.inf)).values())).all()
    with pytest.raises(ValueError, match=r'\(1, 6\), \(1, 5\)'):
        error_metrics(ESTIMATE, TRUTH[:, :5])


def test_the_hard_scenes_count_half():
    scenes = {'Teddy': {'avgerr': 2.0}, 'Vintage': {'avgerr': 8.0}}
    assert weighted_average(scenes, MIDDLEBURY_WEIGHTS) == {'avgerr': pytest.approx(4.0)}
