import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svdm_core.disparity_refinement.settled_pixels import settled_pixels
from svdm_core.disparity_refinement.weighted_median import weighted_median

ERROR = 1e-4  # what the weights of weighted_median may be off


def scene(shape, channels, labels, levels, seed):
    """Slanted planes with noise, and an image of as many grey levels."""
    rng = np.random.default_rng(seed)
    height, width = shape
    planes = np.add.outer(np.arange(height) // 5, np.arange(width) // 4) + rng.integers(0, labels, shape) // 2
    guide = rng.integers(0, levels + 1, (channels, *shape)) / np.float32(levels)
    return planes.astype(np.int32), guide.astype(np.float32)


def own_median(labels, guide, window, sigma_s, sigma_c):
    """Where the whole weights find the pixel's own label."""
    everywhere = np.ones(labels.shape, bool)
    return weighted_median(labels, guide, everywhere, window, sigma_s, sigma_c) == labels


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.tuples(st.integers(1, 12), st.integers(1, 70)), st.sampled_from([1, 3]), st.sampled_from([1, 3, 40, 900]),
       st.sampled_from([1, 7, 255, 65535]), st.sampled_from([1, 3, 9, 31, 101]), st.sampled_from([0.1, 4.0, 1000.0]),
       st.sampled_from([0.001, 0.03, 0.175, 0.49, 0.6, 5.0, 100.0]), st.integers(0, 2**32 - 1))
def test_what_is_settled_is_what_the_whole_weights_find(
        shape, channels, count, levels, window, sigma_s, sigma_c, seed):
    labels, guide = scene(shape, channels, count, levels, seed)
    settled = settled_pixels(labels, guide, window, sigma_s, sigma_c, ERROR)
    assert not (settled & ~own_median(labels, guide, window, sigma_s, sigma_c)).any()


@pytest.mark.parametrize(('channels', 'levels', 'sigma_c', 'share'), [
    (1, 255, 0.175, 0.98), (3, 255, 0.175, 0.97), (1, 255, 0.05, 0.97), (3, 255, 2.0, 0.97), (1, 4095, 0.175, 0.85)])
def test_hardly_a_pixel_is_left_open(channels, levels, sigma_c, share):
    """Slanted planes of which one pixel in five was mistaken, under smooth shading."""
    rng = np.random.default_rng(5)
    rows, columns = np.indices((40, 60))
    labels = np.where(rng.random((40, 60)) < 0.2, rng.integers(0, 64, (40, 60)), columns // 5 + 9).astype(np.int32)
    shading = 0.2 + rows / 200 + columns / 150 + rng.random((channels, 40, 60)) / 20
    guide = (np.rint(shading * levels) / np.float32(levels)).astype(np.float32)
    own = own_median(labels, guide, 21, 14.0, sigma_c)
    settled = settled_pixels(labels, guide, 21, 14.0, sigma_c, ERROR)
    assert own.sum() > 200 and settled[own].mean() > share


def test_a_tie_is_left_open():
    """Two labels of equal weight: the smaller is the median, by the whole weights only."""
    labels, guide = np.array([[0, 5]], np.int32), np.zeros((1, 1, 2), np.float32)
    assert not settled_pixels(labels, guide, 3, 1000.0, 100.0, ERROR).any()
    assert own_median(labels, guide, 3, 1000.0, 100.0).tolist() == [[True, False]]
