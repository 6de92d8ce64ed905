import cv2
import numpy as np
import oracles
import pytest
from scenes import noise

from svdm_core import MatcherParameters
from svdm_core.matching_cost import (
    BLOCK,
    empty_planes,
    fill_planes,
    gradient,
    intensities,
    matching_cost_blocks,
    node_values,
)

SIZES = [(1, 1), (1, 9), (7, 1), (6, 11)]


@pytest.mark.parametrize('kind', ['horizontal', 'magnitude'])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('size', SIZES)
def test_gradient_is_that_of_the_equation(size, dtype, kind):
    grey = noise(*size, dtype=dtype)
    np.testing.assert_allclose(gradient(grey, kind), oracles.gradient(grey, kind), atol=1e-6)


def test_gradient_of_a_falling_edge_is_negative():
    assert gradient(np.array([[200, 200, 100, 100]], np.uint8), 'horizontal')[0, 1] == pytest.approx(-50 / 255)


@pytest.mark.parametrize('shape', [(3, 5), (3, 5, 3)])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
def test_intensities_are_planes_on_0_to_1(shape, dtype):
    image = noise(*shape, dtype=dtype)
    np.testing.assert_allclose(intensities(image), np.moveaxis(oracles.channels(image), 2, 0), rtol=1e-6)


def cost_volume(left, right, parameters, blocks=1):
    """Stage 1 for both views in pixel order: (2, H, W, D), the right view's columns still mirrored."""
    height, width = left.shape[:2]
    rounds = -(-parameters.num_disparities // (blocks * BLOCK))
    planes = empty_planes(height, width, 1 if left.ndim == 2 else 3,
                          parameters.min_disparity + rounds * blocks * BLOCK)
    fill_planes(left, right, parameters.gradient, planes)
    # any order of nodes must do: take a random one
    pixel = np.stack([np.random.default_rng(view).permutation(height * width) for view in range(2)]).astype(np.int32)
    partner, values = node_values(planes, pixel, width)
    cost = np.empty((2, blocks, height * width, BLOCK), np.float32)
    volume = np.empty((2, height * width, rounds * blocks * BLOCK), np.float32)
    for first in range(0, volume.shape[2], blocks * BLOCK):
        matching_cost_blocks(partner, values, planes, first, parameters, cost)
        for view in range(2):
            rows = np.concatenate(list(cost[view]), axis=1)
            volume[view, pixel[view], first:first + blocks * BLOCK] = rows
    return volume.reshape(2, height, width, -1)[..., :parameters.num_disparities]


@pytest.mark.parametrize('kind', ['horizontal', 'magnitude'])
@pytest.mark.parametrize(('size', 'min_disparity', 'num_disparities', 'blocks'), [
    ((1, 1), 0, 1, 1), ((1, 9), 0, 4, 1), ((7, 1), 2, 3, 1), ((5, 23), 0, 16, 1), ((5, 23), 3, 17, 1),
    ((4, 40), 1, 50, 3),
])
@pytest.mark.parametrize('depth', [1, 3])
def test_cost_of_both_views_is_that_of_the_equations(size, depth, min_disparity, num_disparities, blocks, kind):
    shape = size if depth == 1 else (*size, 3)
    # near values, so that both terms stay below their truncation here and there
    left, right = noise(*shape) // 8 + np.uint8(90), noise(*shape, seed=1) // 8 + np.uint8(90)
    parameters = MatcherParameters(min_disparity=min_disparity, num_disparities=num_disparities, gradient=kind,
                                   tau_ad=0.05, tau_gm=0.03, alpha=2.0)
    volume = cost_volume(left, right, parameters, blocks)

    grey = [image if image.ndim == 2 else _grey(image) for image in (left, right)]
    slopes = [oracles.gradient(image, kind) for image in grey]
    np.testing.assert_allclose(volume[0], oracles.matching_cost(left, right, *slopes, parameters), atol=2e-6)
    mirrored = oracles.matching_cost(right[:, ::-1], left[:, ::-1], slopes[1][:, ::-1], slopes[0][:, ::-1], parameters)
    np.testing.assert_allclose(volume[1], mirrored, atol=2e-6)


def _grey(image):
    return cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


def test_uint16_costs_what_uint8_costs():
    left, right = noise(6, 30), noise(6, 30, seed=1)
    parameters = MatcherParameters(num_disparities=8, tau_ad=1.0, tau_gm=1.0)
    deep = [image.astype(np.uint16) * 257 for image in (left, right)]
    np.testing.assert_allclose(cost_volume(*deep, parameters), cost_volume(left, right, parameters), rtol=1e-5)
