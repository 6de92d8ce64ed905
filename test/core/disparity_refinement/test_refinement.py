import numpy as np
import oracles
import pytest
import stages
from scenes import labels, noise

from svdm_core import MatcherParameters
from svdm_core.disparity_optimization.winners import Winners
from svdm_core.disparity_refinement.refinement import Refinement
from svdm_core.phases import Crew, StageClock

PARAMETERS = MatcherParameters(min_disparity=-3, num_disparities=8, w_p=5, sigma_s=2.0, sigma_c=0.3, final_median=1,
                               tau_lr=2.0, intensity_range='full', uniqueness=0.0, filling='scanline', plane_fit=False)


def refined(image, left, right, vertex, parameters):
    """(disparity, valid); right: in the direction of the image."""
    crew = Crew()
    crew.gather(1)
    winners = Winners(left, np.ascontiguousarray(right[:, ::-1]), 1, vertex, np.zeros((0, 0), np.uint8))
    pair = stages.images(image, image, parameters)
    return Refinement(image.shape, parameters).run(winners, pair, parameters, crew, StageClock())[:2]


@pytest.mark.parametrize('scope', ['filled', 'all'])
@pytest.mark.parametrize('guide', ['image', 'disparity'])
@pytest.mark.parametrize('shape', [(6, 9), (6, 9, 3)])
def test_refinement_is_check_fill_and_median_of_the_scope(shape, guide, scope):
    image = noise(*shape) // 4
    left, right = (labels(shape[:2], seed).astype(np.int16) for seed in (1, 2))
    vertex = np.random.default_rng(3).uniform(-0.5, 0.5, shape[:2]).astype(np.float32)
    vertex[left == 0] = 0
    disparity, valid = refined(image, left, right, vertex, PARAMETERS.replace(median_guide=guide, median_scope=scope))
    np.testing.assert_array_equal(valid, oracles.left_right_check(left, right, -3, 2.0))
    assert 0.2 < valid.mean() < 0.8
    filled = oracles.fill(left, valid)
    planes = np.moveaxis(oracles.channels(image), 2, 0) if guide == 'image' else filled[None] / 8
    for y, x in np.ndindex(*left.shape):
        above = disparity[y, x] + 3
        if valid[y, x] and (scope == 'filled' or abs(above - left[y, x]) <= 0.5):
            assert above == pytest.approx(left[y, x] + vertex[y, x], abs=0.51 / 64)
            median = left[y, x]
        else:
            assert above == np.round(above)
            median = int(above)
        if scope == 'all' or not valid[y, x]:
            histogram = oracles.median_histogram(filled, planes, y, x, 5, 2.0, 0.3)
            assert oracles.is_weighted_median(int(median), histogram, tolerance=0.05)


@pytest.mark.parametrize('scope', ['filled', 'all'])
@pytest.mark.parametrize('side', [3, 5])
@pytest.mark.parametrize('shape', [(1, 1), (1, 6), (7, 2), (9, 12)])
def test_the_final_median_is_of_the_finished_map_its_border_replicated(shape, side, scope):
    left, right = (labels(shape, seed).astype(np.int16) for seed in (1, 2))
    vertex = np.random.default_rng(3).uniform(-0.5, 0.5, shape).astype(np.float32)
    vertex[left == 0] = 0
    parameters = PARAMETERS.replace(median_scope=scope)
    before, after = (refined(noise(*shape), left, right, vertex, parameters.replace(final_median=n))[0]
                     for n in (1, side))
    padded = np.pad(before, side // 2, mode='edge')
    for y, x in np.ndindex(*shape):
        assert after[y, x] == np.median(padded[y:y + side, x:x + side])


def test_without_subpixel_disparities_are_whole():
    left = labels((5, 7), 1).astype(np.int16)
    disparity, _ = refined(noise(5, 7), left, left, np.zeros((0, 0), np.float32), PARAMETERS.replace(tau_lr=1024.0))
    assert disparity.dtype == np.float32 and (disparity == np.round(disparity)).all()


def test_more_disparities_than_bytes_can_tell_apart_take_the_literal_median():
    image, count = noise(9, 12), 300
    left = labels((9, 12), 1, count).astype(np.int16)
    disparity, valid = refined(image, left, left, np.zeros((0, 0), np.float32),
                               PARAMETERS.replace(num_disparities=count, tau_lr=0.0))
    assert not valid.any() and disparity.max() > 255
    for y, x in np.ndindex(9, 12):
        histogram = oracles.median_histogram(left, image[None] / 255, y, x, 5, 2.0, 0.3)
        assert oracles.is_weighted_median(int(disparity[y, x]) + 3, histogram)
