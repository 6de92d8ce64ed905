import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import noise
from stages import Stages

from svdm_core import MatcherParameters
from svdm_core.disparity_optimization.winners import Winners


def scene(height, width, step, seed):
    """A pair with few grey levels: many equal costs."""
    return [noise(height, width, seed=seed + k) // step * step for k in range(2)]


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(1, 70), st.integers(1, 5), st.sampled_from([1, 100]), st.integers(0, 2**32 - 2))
def test_winner_and_vertex_are_those_of_the_whole_volume(disparities, slots, step, seed):
    parameters = MatcherParameters(num_disparities=disparities, tau_ad=0.5, census_weight=0.0, sigma_tree=0.1)
    stages = Stages(*scene(3, 40, step, seed), parameters, slots)
    volume = stages.volume()
    winner, vertex = stages.winners()
    np.testing.assert_array_equal(winner, volume.argmin(axis=3))  # argmin takes the first of equals
    for y, x in np.ndindex(3, 40):
        d = winner[0, y, x]
        inside = 0 < d < disparities - 1
        expected = oracles.symmetric_v(*volume[0, y, x, d - 1:d + 2].astype(float)) if inside else 0.0
        assert vertex[y, x] == pytest.approx(expected, abs=2e-4)


def test_a_second_frame_owes_nothing_to_the_first():
    parameters = MatcherParameters(num_disparities=40)
    first, second = (Stages(*scene(6, 50, 1, seed), parameters) for seed in (1, 7))
    winners = Winners.empty(1, 300)
    first.winners(winners)
    again, fresh = second.winners(winners), second.winners()
    np.testing.assert_array_equal(again[0], fresh[0])
    np.testing.assert_array_equal(again[1], fresh[1])


def test_without_subpixel_the_winners_are_the_same():
    parameters = MatcherParameters(num_disparities=50)
    pair = scene(5, 60, 1, 6)
    with_vertex, without = (Stages(*pair, parameters.replace(subpixel=on)).winners()[0] for on in (True, False))
    np.testing.assert_array_equal(with_vertex, without)
