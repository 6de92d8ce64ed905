import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import noise
from stages import ExactStage

from svdm_core import MatcherParameters
from svdm_core.disparity_optimization.winners import empty_best, winners_of

PARAMETERS = MatcherParameters(num_disparities=40, intensity_range='full')


def scene(height, width, step, seed):
    """A pair with few grey levels: many equal costs."""
    return [noise(height, width, seed=seed + k) // step * step for k in range(2)]


def images_of(stage, best):
    return winners_of(best, stage.trees.pixel, stage.shape, stage.parameters.num_disparities, stage.per_slot)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(1, 70), st.integers(1, 5), st.sampled_from([1, 100]), st.integers(0, 2**32 - 2))
def test_winner_and_vertex_are_those_of_the_whole_volume(disparities, slots, step, seed):
    parameters = PARAMETERS.replace(num_disparities=disparities, tau_ad=0.5, census_weight=0.0, sigma_tree=0.1)
    stage = ExactStage(*scene(3, 40, step, seed), parameters, slots)
    volume = stage.volume()
    left, right, vertex = images_of(stage, stage.best())
    np.testing.assert_array_equal(left, volume[0].argmin(axis=2))  # argmin takes the first of equals
    np.testing.assert_array_equal(right, volume[1].argmin(axis=2))
    for y, x in np.ndindex(3, 40):
        d = left[y, x]
        inside = 0 < d < disparities - 1
        expected = oracles.symmetric_v(*volume[0, y, x, d - 1:d + 2].astype(float)) if inside else 0.0
        assert vertex[y, x] == pytest.approx(expected, abs=2e-4)


def test_a_second_frame_owes_nothing_to_the_first():
    first, second = (ExactStage(*scene(6, 50, 1, seed), PARAMETERS) for seed in (1, 7))
    best = first.best()
    again, fresh = images_of(second, second.best(best)), images_of(second, second.best())
    for one, other in zip(again, fresh, strict=True):
        np.testing.assert_array_equal(one, other)


def test_without_subpixel_the_winners_are_the_same():
    stage = ExactStage(*scene(5, 60, 1, 6), PARAMETERS)
    with_vertex = images_of(stage, stage.best())
    stage.parameters = PARAMETERS.replace(subpixel=False)
    without = images_of(stage, stage.best(empty_best(1, 300, False)))
    np.testing.assert_array_equal(with_vertex[0], without[0])
    np.testing.assert_array_equal(with_vertex[1], without[1])
    assert with_vertex[2].any() and not without[2].any()
