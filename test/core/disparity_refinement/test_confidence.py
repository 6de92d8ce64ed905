import numpy as np
import oracles
import pytest
from scenes import noise
from stages import run, task_phase

from svdm_core.disparity_refinement import confidence
from svdm_core.kernels.stripes import block_count


def trusted(valid, margin, grey, level_gain=1.0):
    """(confidence, support)."""
    trust = confidence.Trust(np.full(valid.shape, 9, np.float32), np.full(valid.shape, 9, np.uint8))
    evidence = confidence.Evidence(valid, margin, grey, confidence.least_texture(level_gain))
    run(task_phase(block_count(len(valid)), confidence.fill_confidence, evidence, trust,
                   scratch=confidence.scratch_size(valid.shape[1])))
    return trust


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('shape', [(1, 1), (1, 12), (12, 1), (3, 5), (16, 9), (37, 23)])
def test_it_is_the_mean_margin_of_valid_pixels_where_there_is_texture(shape, dtype):
    rng = np.random.default_rng(1)
    valid, margin = rng.random(shape) < 0.7, rng.integers(0, 256, shape).astype(np.uint8)
    gain = 1.0 if dtype == np.uint8 else 1 / 256
    grey = noise(*shape, dtype=dtype)
    grey[:, shape[1] // 2:] = 77  # no texture there
    found = trusted(valid, margin, grey, gain)
    expected = oracles.confidence(valid, margin, grey, 0.1 / gain)
    np.testing.assert_allclose(found.confidence, expected, atol=1e-6)
    support = oracles.confidence(valid, margin, noise(*shape), -1)
    np.testing.assert_allclose(found.support, np.where(valid, 255 * support, 0), atol=1.001)


def test_without_margins_each_valid_pixel_counts_in_full():
    valid = np.random.default_rng(1).random((20, 30)) < 0.5
    grey = noise(20, 30)
    found = trusted(valid, np.zeros((0, 0), np.uint8), grey)
    expected = oracles.confidence(valid, np.full(valid.shape, 255), grey, 0.1)
    np.testing.assert_allclose(found.confidence, expected, atol=1e-6)
    assert found.confidence.max() < 1


@pytest.mark.parametrize('slope', [0, 1])
def test_a_tenth_of_a_grey_level_a_pixel_is_texture(slope):
    """A ramp that rises by a level in eight pixels, and one in sixteen."""
    grey = (np.arange(96) // (8 if slope else 16)).astype(np.uint8) * np.ones((20, 1), np.uint8)
    everywhere = np.ones(grey.shape, np.bool_)
    found = trusted(everywhere, np.full(grey.shape, 255, np.uint8), grey).confidence[8:12, 16:80]
    assert (found > 0.999).all() if slope else (found == 0).any()
