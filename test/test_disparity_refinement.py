import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import noise

from svdm_core import MatcherParameters
from svdm_core.disparity_refinement.filling import fill_along_scanlines
from svdm_core.disparity_refinement.left_right import left_right_check
from svdm_core.disparity_refinement.refinement import refine

SHAPES = st.tuples(st.integers(1, 6), st.integers(1, 12))


def labels(shape, seed, end=8):
    return np.random.default_rng(seed).integers(0, end, shape).astype(np.int32)


@settings(max_examples=60, deadline=None, derandomize=True)
@given(SHAPES, st.integers(0, 4), st.sampled_from([0.0, 0.5, 1.0, 2.5]), st.integers(0, 2**32 - 1))
def test_left_right_check_is_equation_15(shape, min_disparity, tau_lr, seed):
    left, right = labels(shape, seed, 4), labels(shape, seed + 1, 4)
    np.testing.assert_array_equal(left_right_check(left, right[:, ::-1], min_disparity, tau_lr),
                                  oracles.left_right_check(left, right, min_disparity, tau_lr))


@settings(max_examples=80, deadline=None, derandomize=True)
@given(SHAPES, st.floats(0, 1), st.integers(0, 2**32 - 1))
def test_filling_is_equation_16(shape, share, seed):
    disparity, valid = labels(shape, seed), np.random.default_rng(seed).random(shape) < share
    before = disparity.copy()
    np.testing.assert_array_equal(fill_along_scanlines(disparity, valid), oracles.fill(disparity, valid))
    np.testing.assert_array_equal(disparity, before)


def test_filling_takes_the_background():
    disparity = np.array([[9, 0, 0, 3, 0]], np.int32)
    assert fill_along_scanlines(disparity, disparity > 0).tolist() == [[9, 3, 3, 3, 3]]


@pytest.mark.parametrize('scope', ['filled', 'all'])
@pytest.mark.parametrize('guide', ['image', 'disparity'])
@pytest.mark.parametrize('shape', [(6, 9), (6, 9, 3)])
def test_refinement_is_fill_and_median_of_the_scope(shape, guide, scope):
    left = noise(*shape) // 4
    winner, valid = labels(shape[:2], 1), np.random.default_rng(2).random(shape[:2]) < 0.7
    vertex = np.random.default_rng(3).uniform(-0.5, 0.5, shape[:2]).astype(np.float32)
    parameters = MatcherParameters(min_disparity=5, num_disparities=8, median_guide=guide, median_scope=scope, w_p=5,
                                   sigma_s=2.0, sigma_c=0.3, final_median=1)
    disparity = refine(winner, vertex, valid, left, parameters)

    filled = oracles.fill(winner, valid)
    planes = np.moveaxis(oracles.channels(left), 2, 0) if guide == 'image' else filled[None] / 8
    for y, x in np.ndindex(*winner.shape):
        median = np.round(disparity[y, x] - 5)
        if valid[y, x] and (scope == 'filled' or abs(disparity[y, x] - 5 - winner[y, x]) <= 0.5):
            median = winner[y, x]
            assert disparity[y, x] == pytest.approx(5 + winner[y, x] + vertex[y, x])
        else:
            assert disparity[y, x] == 5 + median
        if scope == 'all' or not valid[y, x]:
            assert oracles.is_weighted_median(int(median), oracles.median_histogram(filled, planes, y, x, 5, 2.0, 0.3))


@pytest.mark.parametrize('side', [3, 5])
@pytest.mark.parametrize('shape', [(1, 1), (1, 6), (7, 2), (9, 12)])
def test_the_final_median_is_of_the_finished_map_its_border_replicated(shape, side):
    winner, valid = labels(shape, 1), np.random.default_rng(2).random(shape) < 0.7
    vertex = np.random.default_rng(3).uniform(-0.5, 0.5, shape).astype(np.float32)
    before, after = (refine(winner, vertex, valid, noise(*shape), MatcherParameters(num_disparities=8, final_median=n))
                     for n in (1, side))
    padded = np.pad(before, side // 2, mode='edge')
    for y, x in np.ndindex(*shape):
        assert after[y, x] == np.median(padded[y:y + side, x:x + side])


def test_without_subpixel_disparities_are_whole():
    winner, valid = labels((5, 7), 1), np.ones((5, 7), bool)
    disparity = refine(winner, None, valid, noise(5, 7), MatcherParameters(num_disparities=8, final_median=1))
    np.testing.assert_array_equal(disparity, winner)
    assert disparity.dtype == np.float32
