import cv2
import numpy as np
import oracles
import pytest
from scenes import noise
from stages import Stages

from svdm_core import MatcherParameters
from svdm_core.matching_cost.planes import INTENSITY, MatchingPlanes, intensities

SIZES = [(1, 1), (1, 9), (7, 1), (6, 11)]


def planes_of(left, right, kind='horizontal', census=False):
    planes = MatchingPlanes.empty(left.shape, 3, census)
    planes.fill(left, right, kind)
    return planes


@pytest.mark.parametrize('kind', ['horizontal', 'magnitude'])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('size', SIZES)
def test_gradient_is_that_of_the_equation_to_half_a_64th_of_a_grey_level(size, dtype, kind):
    left, right = noise(*size, dtype=dtype), noise(*size, dtype=dtype, seed=1)
    planes = planes_of(left, right, kind).values[:, -1, :, :size[1]] / INTENSITY
    np.testing.assert_allclose(planes[0], oracles.gradient(left, kind), atol=0.51 / INTENSITY)
    np.testing.assert_allclose(planes[1, :, ::-1], oracles.gradient(right, kind), atol=0.51 / INTENSITY)


def test_gradient_of_a_falling_edge_is_negative():
    grey = np.array([[200, 200, 100, 100]], np.uint8)
    assert planes_of(grey, grey).values[0, -1, 0, 1] == -50 * 64


@pytest.mark.parametrize('shape', [(3, 5), (3, 5, 3)])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
def test_intensities_are_planes_on_0_to_1(shape, dtype):
    image = noise(*shape, dtype=dtype)
    np.testing.assert_allclose(intensities(image), np.moveaxis(oracles.channels(image), 2, 0), rtol=1e-6)


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('size', [*SIZES, (9, 20)])
def test_census_has_a_bit_for_each_darker_neighbour(size, dtype):
    left, right = noise(*size, dtype=dtype), noise(*size, dtype=dtype, seed=1) // 64  # with equals
    census = planes_of(left, right, census=True).census[:, :, :size[1]]
    np.testing.assert_array_equal(census[0], oracles.census(left))
    np.testing.assert_array_equal(census[1, :, ::-1], oracles.census(right))


@pytest.mark.parametrize('kind', ['horizontal', 'magnitude'])
@pytest.mark.parametrize(('size', 'min_disparity', 'num_disparities'), [
    ((1, 1), 0, 1), ((1, 9), 0, 4), ((7, 1), 2, 3), ((5, 23), 0, 16), ((5, 23), 3, 17), ((4, 40), 1, 50),
])
@pytest.mark.parametrize(('depth', 'census_weight'), [(1, 0.0), (3, 0.0), (1, 0.3), (3, 0.2)])
def test_cost_of_both_views_is_that_of_the_equations(size, depth, min_disparity, num_disparities, kind, census_weight):
    shape = size if depth == 1 else (*size, 3)
    # near values, so that both terms stay below their truncation here and there
    left, right = noise(*shape) // 8 + np.uint8(90), noise(*shape, seed=1) // 8 + np.uint8(90)
    parameters = MatcherParameters(min_disparity=min_disparity, num_disparities=num_disparities, gradient=kind,
                                   tau_ad=0.05, tau_gm=0.03, alpha=2.0, census_weight=census_weight)
    volume = Stages(left, right, parameters, isolated=True).volume()

    grey = [image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (left, right)]
    slopes = [oracles.gradient(image, kind) for image in grey]
    bits = [oracles.census(image) for image in grey]
    # gradient magnitudes are rounded to whole units of the planes
    tolerance = 2e-6 if kind == 'horizontal' else 2.1 / INTENSITY
    expected = oracles.matching_cost(left, right, *slopes, *bits, parameters)
    np.testing.assert_allclose(volume[0], expected, atol=tolerance)
    mirrored = (image[:, ::-1] for image in (right, left, *slopes[::-1], *bits[::-1]))
    np.testing.assert_allclose(volume[1], oracles.matching_cost(*mirrored, parameters), atol=tolerance)


def test_uint16_costs_what_uint8_costs():
    left, right = noise(6, 30), noise(6, 30, seed=1)
    parameters = MatcherParameters(num_disparities=8, tau_ad=1.0, tau_gm=1.0)
    deep = [image.astype(np.uint16) * 257 for image in (left, right)]
    volumes = [Stages(*pair, parameters, isolated=True).volume() for pair in (deep, (left, right))]
    np.testing.assert_allclose(*volumes, rtol=1e-5)
