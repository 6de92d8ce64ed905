import numpy as np
import oracles
import pytest
from scenes import labels, noise

from svdm_core import MatcherParameters
from svdm_core.disparity_refinement.refinement import refine


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
