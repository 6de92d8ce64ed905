"""Against exact integers, and these against the equations."""
import cv2
import numba
import numpy as np
import oracles
import pytest
from scenes import noise
from stages import ByteStage

from svdm_core import MatcherParameters
from svdm_core.kernels.vectors import pointer
from svdm_core.kernels.wide import UNIT, store_wide
from svdm_core.matching_cost import byte_costs
from svdm_core.matching_cost.planes import INTENSITY

WEIGHTS = {
    'all': {}, 'magnitude': {'gradient': 'magnitude', 'tau_ad': 0.3, 'tau_gm': 0.2, 'alpha': 0.7},
    'census': {'tau_ad': 0.0, 'alpha': 0.0}, 'differences': {'census_weight': 0.0},
    'no differences of intensity': {'tau_ad': 0.0, 'tau_gm': 0.5}, 'long cut off': {'tau_ad': 1.0, 'alpha': 0.0},
}


@numba.njit
def fill_volume(costs, view, volume, lanes):
    for y in range(volume.shape[0]):
        row = byte_costs.cost_row(costs, view, y, volume.shape[1], 0)
        for x in range(volume.shape[1]):
            store_wide(pointer(volume[y, x]), 0, byte_costs.cost_at(row, x, pointer(costs.behind), lanes))


def volume_of(stage, view):
    height, width = stage.pair.left.shape[:2]
    volume = np.zeros((height, width, UNIT * len(stage.lanes)), np.uint8)
    fill_volume(stage.costs, view, volume, stage.lanes)
    return volume


def oracle_of(stage, view, largest):
    """The view in its own direction: the right one mirrored."""
    before, width = stage.planes.before, stage.pair.left.shape[1]
    values, census = (part[..., before:before + width] for part in (stage.planes.values, stage.planes.census))
    other = values[1 - view][..., ::-1]
    return oracles.byte_cost(values[view], other, census[view], census[1 - view][..., ::-1], stage.costs, stage.width,
                             largest)


@pytest.mark.parametrize('weights', WEIGHTS)
@pytest.mark.parametrize(('shape', 'start', 'count'), [
    ((1, 1), 0, 1), ((1, 9), 0, 4), ((7, 1), 2, 3), ((4, 50), 0, 16), ((3, 50), -20, 30), ((2, 40), 3, 50),
    ((2, 60), -64, 33), ((2, 9, 3), 0, 5), ((3, 45, 3), -3, 32),
])
@pytest.mark.parametrize('largest', [34, 255])
def test_costs_are_those_sums_to_the_bit(shape, start, count, weights, largest):
    parameters = MatcherParameters(min_disparity=start, num_disparities=count, **WEIGHTS[weights])
    stage = ByteStage(noise(*shape) // 8, noise(*shape, seed=1) // 8, parameters, largest)
    for view in range(2):
        volume = volume_of(stage, view)
        np.testing.assert_array_equal(volume, oracle_of(stage, view, largest))
        assert (volume[..., count:] == largest).all()


@pytest.mark.parametrize('weights', WEIGHTS)
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('shape', [(4, 50), (3, 45, 3)])
def test_costs_are_those_of_the_equations_to_what_is_rounded(shape, dtype, weights):
    parameters = MatcherParameters(intensity_range='full', num_disparities=30, min_disparity=-5, **WEIGHTS[weights])
    left, right = noise(*shape, dtype=dtype) // 8, noise(*shape, dtype=dtype, seed=1) // 8
    stage = ByteStage(left, right, parameters, 255)
    grey = [image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (left, right)]
    slopes = [oracles.gradient(image, parameters.gradient) for image in grey]
    exact = oracles.matching_cost(left, right, *slopes, *map(oracles.census, grey), parameters)
    unit = 255 / byte_costs.largest_cost(parameters)
    # rounded at the end; the planes before, each value by half of 1 / INTENSITY; a bit of the census by 1/256
    rounded = 0.5 + unit * (1 + parameters.alpha) / INTENSITY + 34 / 256
    np.testing.assert_allclose(volume_of(stage, 0)[..., :30], exact * unit, atol=rounded + 0.05)


@pytest.mark.parametrize('largest', [34, 255])
def test_alike_pixels_cost_nothing_and_the_largest_cost_is_reached(largest):
    image = np.full((3, 20), 50, np.uint8)
    parameters = MatcherParameters(num_disparities=8, census_weight=0.0)
    volume = volume_of(ByteStage(image, image, parameters, largest), 0)
    assert (volume[:, 8:, :8] == 0).all() and (volume[:, 0, 1:] == largest).all()
    bright = volume_of(ByteStage(image, image + 200, MatcherParameters(tau_gm=0.0, census_weight=0.0), largest), 0)
    np.testing.assert_allclose(bright[:, 10, :8], largest, atol=1)


def test_without_any_weight_nothing_costs_anything_but_to_leave_the_image():
    parameters = MatcherParameters(num_disparities=4, tau_ad=0.0, alpha=0.0, census_weight=0.0)
    volume = volume_of(ByteStage(noise(2, 9), noise(2, 9, seed=1), parameters, 255), 0)
    assert (volume[:, 3:, :4] == 0).all() and (volume[:, 0, 1:] == 255).all()
