import cv2
import numpy as np
import oracles
import pytest
import stages
from scenes import noise

from svdm_core import MatcherParameters
from svdm_core.matching_cost.intensity_range import IntensityRange
from svdm_core.matching_cost.planes import INTENSITY, NOTHING, intensities

SIZES = [(1, 1), (1, 9), (7, 1), (20, 11)]
FULL = MatcherParameters(intensity_range='full')


def planes_of(left, right, parameters=FULL):
    return stages.planes(stages.images(left, right, parameters), parameters, 32)


def in_image(planes, width):
    """Values of both views in the direction of the image, (2, C + 1, H, W)."""
    values = planes.values[..., planes.before:planes.before + width]
    return np.stack([values[0], values[1, ..., ::-1]])


@pytest.mark.parametrize('kind', ['horizontal', 'magnitude'])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('size', SIZES)
def test_gradient_is_that_of_the_equation_to_half_a_64th_of_a_grey_level(size, dtype, kind):
    pair = noise(*size, dtype=dtype), noise(*size, dtype=dtype, seed=1)
    planes = in_image(planes_of(*pair, FULL.replace(gradient=kind)), size[1])[:, -1] / INTENSITY
    for view, image in enumerate(pair):
        np.testing.assert_allclose(planes[view], oracles.gradient(image, kind), atol=0.51 / INTENSITY)


def test_gradient_of_a_falling_edge_is_negative():
    grey = np.array([[200, 200, 100, 100]], np.uint8)
    assert in_image(planes_of(grey, grey), 4)[0, -1, 0].tolist() == [0, -50 * 64, -50 * 64, 0]


@pytest.mark.parametrize('shape', [(3, 5), (3, 5, 3)])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
def test_intensities_are_planes_on_0_to_1(shape, dtype):
    image = noise(*shape, dtype=dtype)
    expected = np.moveaxis(oracles.channels(image), 2, 0)
    scale = map(np.float32, IntensityRange.full(dtype))
    np.testing.assert_allclose(intensities(image, tuple(scale)), expected, rtol=1e-6)
    values = in_image(planes_of(image, image[::-1]), 5)[:, :-1] / INTENSITY
    np.testing.assert_allclose(values[0], expected, atol=0.51 / INTENSITY)
    np.testing.assert_allclose(values[1], expected[:, ::-1], atol=0.51 / INTENSITY)


@pytest.mark.parametrize('start', [-7, 0, 4])
def test_where_there_is_no_pixel_the_values_say_so(start):
    planes = planes_of(noise(3, 5), noise(3, 5, seed=1), FULL.replace(min_disparity=start)).values
    nothing = np.delete(planes, np.s_[max(-start, 0):max(-start, 0) + 5], axis=3)
    assert (nothing == NOTHING).all() and (planes != NOTHING).sum() == 2 * 2 * 3 * 5


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('size', [*SIZES, (9, 50)])
def test_census_has_a_bit_for_each_darker_neighbour(size, dtype):
    pair = noise(*size, dtype=dtype), noise(*size, dtype=dtype, seed=1) // 64  # with equals
    planes = planes_of(*pair, FULL.replace(min_disparity=-3))
    census = planes.census[..., 3:3 + size[1]]
    np.testing.assert_array_equal(census[0], oracles.census(pair[0]))
    np.testing.assert_array_equal(census[1, ..., ::-1], oracles.census(pair[1]))
    assert (planes.census < 16).all()


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
def test_a_grey_image_of_a_colour_one_is_that_of_opencv(dtype):
    pair = noise(20, 33, 3, dtype=dtype), noise(20, 33, 3, dtype=dtype, seed=1)
    images = stages.images(*pair, FULL)
    for grey, image in zip((images.left_grey, images.right_grey), pair, strict=True):
        apart = np.abs(grey.astype(int) - cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))
        assert apart.max() <= (0 if dtype == np.uint8 else 2)  # 15 bits of weights there, 14 for uint16


@pytest.mark.parametrize('range_', ['pair', 'full'])
@pytest.mark.parametrize('shape', [(5, 9), (20, 7, 3)])
def test_levels_are_those_of_the_range(shape, range_):
    for dtype in (np.uint8, np.uint16):
        left, right = noise(*shape, dtype=dtype) // 3 + 9, noise(*shape, dtype=dtype, seed=1) // 3 + 9
        images = stages.images(left, right, FULL.replace(intensity_range=range_))
        value = (left.reshape(*shape[:2], -1) - float(images.level_offset)) * float(images.level_gain)
        if dtype == np.uint8:
            np.testing.assert_array_equal(value, left.reshape(value.shape))
        np.testing.assert_allclose(np.moveaxis(images.levels, 0, 2), np.clip(value, 0, 255), atol=0.501)
