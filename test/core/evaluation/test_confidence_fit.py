import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svdm_core.evaluation.confidence_fit import Constants, fit, fit_lines, left_out_figures
from svdm_core.evaluation.trust_curves import Tally, auc, tally_of, wrong_at

LEVELS = np.linspace(1, 0, 21)


def scene(constants, pixels=1000.0):
    """As many wrong ones of each confidence as the constants say."""
    return Tally(LEVELS, np.full(LEVELS.size, pixels), pixels * constants.chance(LEVELS))


@given(st.floats(0, 12), st.floats(-3, 3))
def test_the_constants_come_back(slope, offset):
    found = fit(scene(Constants(slope, offset)))
    assert found == pytest.approx((slope, offset), abs=0.01)


@given(st.lists(st.tuples(st.integers(0, 4), st.booleans()), min_size=6, max_size=40))
def test_it_predicts_as_many_wrong_ones_and_their_mean_confidence(pixels):
    """What the greatest likelihood of a logistic function is known by."""
    confidence, wrong = (np.array(values) for values in zip(*pixels, strict=True))
    confidence = confidence / 4
    found = fit(tally_of(confidence, wrong))
    assert np.isfinite(found).all()
    chance = found.chance(confidence)
    assert chance.mean() == pytest.approx(wrong.mean(), abs=1e-4)
    assert (chance * confidence).mean() == pytest.approx((wrong * confidence).mean(), abs=1e-4)


def test_a_scene_is_judged_by_the_constants_of_the_others():
    first, second = Constants(3.0, 0.2), Constants(6.0, 1.5)
    scenes = {'Attic': scene(first, 10), 'Barn': scene(second, 5000)}
    found = left_out_figures(scenes)
    for name, other in (('Attic', second), ('Barn', first)):
        of_it = found['scenes'][name]
        assert (of_it['slope'], of_it['offset']) == pytest.approx(other, abs=0.01)
        assert of_it['calibration_error'] > 0.05 and of_it['auc'] == pytest.approx(auc(scenes[name]))
    left_out, worst = found['left_out'], min(scenes, key=lambda name: auc(scenes[name]))
    assert 3 < found['slope'] < 6 and left_out['auc_worst_scene'] == worst
    assert left_out['auc_mean'] == pytest.approx(np.mean([auc(one) for one in scenes.values()]))
    assert left_out['wrong']['80'] == pytest.approx(np.mean([wrong_at(one, 80) for one in scenes.values()]))
    alike = left_out_figures({'Attic': scene(first), 'Barn': scene(first, 7)})['left_out']
    assert alike['calibration_error'] < 1e-3 and alike['calibration_error_of_a_scene']['worst'] < 1e-3
    text = '\n'.join(fit_lines(found))
    assert f'1 / (1 + exp({found["slope"]:.3f} c - {found["offset"]:.3f}))' in text and f'({worst})' in text


def test_one_scene_cannot_be_left_out():
    with pytest.raises(ValueError, match='needs two scenes or more, to leave one out: there are 1'):
        left_out_figures({'Attic': scene(Constants(3, 0))})
