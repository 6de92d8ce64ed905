"""Stage 4 alone, on what stages 1 to 3 gave."""
import numpy as np
import pytest
from scenes import noise

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
        assert set(result.timings) == set(expected.timings)
    assert result.timings['total'] == pytest.approx(sum(result.timings.values()) / 2)


def test_only_parameters_of_stage_4_may_change():
    matcher = StereoMatcher(PARAMETERS)
    matched = matcher.match(noise(30, 50), noise(30, 50, seed=1))
    assert matched.outdated_by(PARAMETERS.replace(tau_lr=3.0, w_p=9)) == []
    matcher.parameters = PARAMETERS.replace(alpha=2.0)
    with pytest.raises(ValueError, match=r'alpha = 2.0 is not allowed: it must be 10.7, with which'):
        matcher.refine(matched)
