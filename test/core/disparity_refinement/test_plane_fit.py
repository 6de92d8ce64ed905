import numpy as np
import oracles
import pytest
from stages import run, task_phase

from svdm_core.disparity_refinement import plane_fit
from svdm_core.disparity_refinement.byte_median import STEPS
from svdm_core.kernels.stripes import block_count


def fitted(fixed, support, levels, search=(0, 1024), level_unit=1.0):
    """The map in px; fixed: uint16 (H, W), 1 / STEPS px."""
    disparity = np.full(fixed.shape, 9, np.float32)
    run(task_phase(block_count(len(fixed)), plane_fit.fit_planes, plane_fit.PlaneMaps(fixed, support, levels),
                   plane_fit.plane_weights(level_unit), search, disparity,
                   scratch=plane_fit.scratch_size(fixed.shape[1], len(levels))))
    return disparity


def scene(shape, channels, seed=0):
    """A slope with noise and a step in it, support of all kinds, a guide with an edge elsewhere."""
    rng = np.random.default_rng(seed)
    y, x = np.indices(shape)
    disparity = 20 + 0.2 * x - 0.1 * y + rng.normal(0, 0.3, shape) + 5 * (x > shape[1] // 2)
    levels = rng.integers(90, 112, (channels, *shape)) + 60 * (y > shape[0] // 2)
    return (np.rint(STEPS * disparity).astype(np.uint16), rng.integers(0, 256, shape).astype(np.uint8),
            levels.astype(np.uint8))


@pytest.mark.parametrize('channels', [1, 3])
@pytest.mark.parametrize('shape', [(1, 1), (1, 30), (30, 1), (16, 16), (19, 45), (40, 17)])
def test_disparities_move_onto_the_plane_of_the_equations(shape, channels):
    fixed, support, levels = scene(shape, channels)
    expected = oracles.plane_fit(fixed / STEPS, np.maximum(support, plane_fit.LEAST_SUPPORT) / 255, levels / 255)
    found = fitted(fixed, support, levels)
    moved = np.abs(expected - fixed / STEPS)
    assert shape[0] * shape[1] < 50 or moved.max() > 0.2
    np.testing.assert_allclose(found, expected, atol=0.15)  # of pixels that hardly anything supports
    assert np.abs(found - expected).mean() < 0.01  # of 1/64 px steps
    np.testing.assert_array_equal(found * STEPS % 1, 0)


def test_a_plane_stays_and_noise_on_it_becomes_less():
    y, x = np.indices((60, 80))
    plane = 30 + 0.25 * x - 0.125 * y
    levels, full = np.full((1, 60, 80), 99, np.uint8), np.full((60, 80), 255, np.uint8)
    still = fitted(np.rint(STEPS * plane).astype(np.uint16), full, levels)
    assert np.abs(still - plane)[6:-6, 8:-8].max() <= 1.5 / STEPS
    noisy = plane + np.random.default_rng(1).normal(0, 0.3, plane.shape)
    smooth = fitted(np.rint(STEPS * noisy).astype(np.uint16), full, levels)
    assert np.abs(smooth - plane).mean() < 0.55 * np.abs(noisy - plane).mean()


def test_a_step_of_depth_and_an_edge_of_the_image_stay_sharp():
    levels, full = np.full((1, 40, 60), 99, np.uint8), np.full((40, 60), 255, np.uint8)
    step = np.where(np.arange(60) < 30, 10 * STEPS, 14 * STEPS) * np.ones((40, 1))
    np.testing.assert_array_equal(fitted(step.astype(np.uint16), full, levels), step / STEPS)
    small = step.copy()
    small[:, 30:] = 10 * STEPS + 48  # 3/4 px: within reach of the weights, were it not for the image
    levels[..., 30:] = 199
    np.testing.assert_array_equal(fitted(small.astype(np.uint16), full, levels), small / STEPS)


@pytest.mark.parametrize('ends', [(0, 1024 * STEPS - STEPS), (37, 21000)])
def test_differences_beyond_16_bits_and_the_ends_of_the_search_range_are_heeded(ends):
    fixed = np.random.default_rng(2).choice(np.array(ends, np.uint16), (20, 30))
    found = fitted(fixed, np.full((20, 30), 255, np.uint8), np.full((1, 20, 30), 99, np.uint8))
    np.testing.assert_array_equal(found, fixed / STEPS)
    x = np.arange(30) * np.ones((20, 1))
    slope = np.rint(STEPS * 0.2 * x).astype(np.uint16)
    found = fitted(slope, np.full((20, 30), 255, np.uint8), np.full((1, 20, 30), 99, np.uint8), (-7, 6))
    assert found.min() >= -7 and found.max() == -2
