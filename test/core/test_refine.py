"""Stage 4 alone, on what stages 1 to 3 gave; what the maps that come out are multiples of; what is compiled."""
import numpy as np
import pytest
from scenes import noise

import svdm_core.matcher
from svdm_core import MatcherParameters, StereoMatcher

PARAMETERS = MatcherParameters(num_disparities=20, w_p=7)


def test_matching_and_refining_is_computing_and_the_matched_pair_stays():
    left, right = noise(30, 50), noise(30, 50, seed=1)
    matcher = StereoMatcher(PARAMETERS)
    expected = matcher.compute(left, right)
    given = left.copy()
    matched = matcher.match(given, right)
    given[:] = 0  # what was matched is a copy
    matcher.compute(right, left)
    for _ in range(2):
        result = matcher.refine(matched)
        np.testing.assert_array_equal(result.disparity, expected.disparity)
        np.testing.assert_array_equal(result.valid, expected.valid)
        np.testing.assert_array_equal(result.confidence, expected.confidence)
        assert set(result.timings) == set(expected.timings)
    assert result.timings['total'] == pytest.approx(sum(result.timings.values()) / 2)


def test_only_parameters_of_stage_4_may_change():
    matcher = StereoMatcher(PARAMETERS)
    matched = matcher.match(noise(30, 50), noise(30, 50, seed=1))
    assert matched.outdated_by(PARAMETERS.replace(tau_lr=3.0, w_p=9)) == []
    matcher.parameters = PARAMETERS.replace(alpha=2.0)
    with pytest.raises(ValueError, match=r'alpha = 2.0 is not allowed: it must be 10.7, with which'):
        matcher.refine(matched)


@pytest.mark.parametrize(('changes', 'step'), [
    ({}, 1 / 64), ({'final_median': 1}, 1 / 64), ({'subpixel': False}, 1 / 64), ({'num_disparities': 1}, 1 / 64),
    ({'median_scope': 'all'}, 1 / 64), ({'min_disparity': -30, 'num_disparities': 40}, 1 / 64),
    ({'plane_fit': False}, 1 / 64), ({'plane_fit': False, 'subpixel': False}, 1),
    ({'plane_fit': False, 'num_disparities': 1}, 1), ({'plane_fit': False, 'median_scope': 'all'}, 0)])
def test_disparities_are_multiples_of_the_step(changes, step):
    result = StereoMatcher(PARAMETERS.replace(**changes)).compute(noise(30, 50), noise(30, 50, seed=1))
    assert result.step == step
    if step:
        np.testing.assert_array_equal(result.disparity / np.float32(step) % 1, 0)
    else:
        assert (result.disparity * 64 % 1 != 0).any()


def test_a_matcher_tells_what_is_not_compiled_until_it_has_matched_it(monkeypatch):
    monkeypatch.setattr(svdm_core.matcher, '_RUN', set())  # other tests have matched before
    matcher = StereoMatcher(PARAMETERS.replace(num_disparities=65, aggregation='box', w_p=5))
    image = noise(8, 12, dtype=np.uint16)
    assert matcher.not_compiled(image) == '16-bit grey images and 65 to 96 disparities'
    matcher.compute(image, image)
    assert matcher.not_compiled(image) == ''
    matcher.parameters = matcher.parameters.replace(num_disparities=96, alpha=1.0, min_disparity=-50)
    assert matcher.not_compiled(image) == ''
    for count, told in ((97, '97 to 128'), (192, '129 to 192'), (20, '1 to 32')):
        matcher.parameters = matcher.parameters.replace(num_disparities=count)
        assert matcher.not_compiled(image) == f'16-bit grey images and {told} disparities'
