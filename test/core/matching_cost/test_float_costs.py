import cv2
import numpy as np
import oracles
import pytest
from scenes import noise
from stages import ExactStage

from svdm_core import MatcherParameters
from svdm_core.matching_cost.planes import INTENSITY


@pytest.mark.parametrize('kind', ['horizontal', 'magnitude'])
@pytest.mark.parametrize(('size', 'min_disparity', 'num_disparities'), [
    ((1, 1), 0, 1), ((1, 9), 0, 4), ((7, 1), 2, 3), ((5, 23), 0, 16), ((5, 23), 3, 17), ((4, 23), -9, 20),
    ((2, 23), -40, 12), ((3, 40), 1, 50),
])
@pytest.mark.parametrize(('depth', 'census_weight'), [(1, 0.0), (3, 0.0), (1, 0.3), (3, 0.2)])
def test_cost_of_both_views_is_that_of_the_equations(size, depth, min_disparity, num_disparities, kind, census_weight):
    shape = size if depth == 1 else (*size, 3)
    # near values, so that both terms stay below their truncation here and there
    left, right = noise(*shape) // 8 + np.uint8(90), noise(*shape, seed=1) // 8 + np.uint8(90)
    parameters = MatcherParameters(min_disparity=min_disparity, num_disparities=num_disparities, gradient=kind,
                                   tau_ad=0.05, tau_gm=0.03, alpha=2.0, census_weight=census_weight,
                                   intensity_range='full')
    volume = ExactStage(left, right, parameters).volume(isolated=True)

    grey = [image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (left, right)]
    slopes = [oracles.gradient(image, kind) for image in grey]
    bits = [oracles.census(image) for image in grey]
    # gradient magnitudes are rounded to whole units of the planes
    tolerance = 2e-6 if kind == 'horizontal' else 2.1 / INTENSITY
    expected = oracles.matching_cost(left, right, *slopes, *bits, parameters)
    np.testing.assert_allclose(volume[0], expected, atol=tolerance)
    mirrored = [image[:, ::-1] for image in (right, left, *slopes[::-1])] + [part[..., ::-1] for part in bits[::-1]]
    np.testing.assert_allclose(volume[1], oracles.matching_cost(*mirrored, parameters), atol=tolerance)


def test_uint16_costs_what_uint8_costs():
    left, right = noise(6, 30), noise(6, 30, seed=1)
    parameters = MatcherParameters(num_disparities=8, tau_ad=1.0, tau_gm=1.0, intensity_range='full')
    deep = [image.astype(np.uint16) * 257 for image in (left, right)]
    volumes = [ExactStage(*pair, parameters).volume(isolated=True) for pair in (deep, (left, right))]
    np.testing.assert_allclose(*volumes, rtol=1e-5)
