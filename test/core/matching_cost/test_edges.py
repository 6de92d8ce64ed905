import numpy as np
import oracles
import pytest
import stages
from scenes import noise

from svdm_core import MatcherParameters
from svdm_core.kernels.stripes import rows_of


@pytest.mark.parametrize('every', [1, 2, 3])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('shape', [(1, 1), (1, 8), (8, 1), (37, 9), (7, 9, 3)])
def test_edges_are_the_largest_channel_differences_in_levels(shape, dtype, every):
    pair = noise(*shape, dtype=dtype), noise(*shape, dtype=dtype, seed=1)
    images = stages.images(*pair, MatcherParameters(intensity_range='full'))
    rows = rows_of(shape, 1), rows_of(shape, every)
    edges = stages.edges(images, *rows)
    matched = pair[0], pair[1][rows[1].offset::rows[1].every, ::-1]
    unit = 1 if dtype == np.uint8 else 257
    for view, image in enumerate(matched):
        assert len(image) == rows[view].height
        across, down = oracles.edges(image)
        np.testing.assert_allclose(edges.across[view, :len(image)], across / unit, atol=0.5 + 1e-5)
        np.testing.assert_allclose(edges.down[view, :len(image)], down / unit, atol=0.5 + 1e-5)


def test_differences_are_rounded_and_not_the_images():
    """100 and 300 are 0.39 and 1.17 levels: their difference is 1 level, as that of 0 and 200 is."""
    image = np.array([[100, 300, 300, 170, 40]], np.uint16)
    images = stages.images(image, image, MatcherParameters(intensity_range='full'))
    rows = rows_of(image.shape, 1)
    assert stages.edges(images, rows, rows).across[:, 0].tolist() == [[0, 1, 0, 1, 1], [0, 1, 1, 0, 1]]
