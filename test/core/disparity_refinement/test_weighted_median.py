import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svdm_core.disparity_refinement.separable_median import separable_median
from svdm_core.disparity_refinement.weighted_median import weighted_median, weighted_median_of_disparity


def scene(height, width, channels, labels, seed):
    rng = np.random.default_rng(seed)
    return rng.integers(0, labels, (height, width)).astype(np.int32), rng.random((channels, height, width), np.float32)


def assert_medians(result, labels, guide, window, sigma_s, sigma_c):
    for y, x in np.ndindex(*labels.shape):
        histogram = oracles.median_histogram(labels, guide, y, x, window, sigma_s, sigma_c)
        assert oracles.is_weighted_median(int(result[y, x]), histogram), (y, x)


@settings(max_examples=40, deadline=None, derandomize=True)
@given(
    st.integers(1, 8), st.integers(1, 20), st.sampled_from([1, 3]), st.sampled_from([1, 2, 40]),
    st.sampled_from([1, 3, 7, 11]), st.sampled_from([0.1, 1.0, 15.8]), st.sampled_from([0.001, 0.1, 0.5, 100.0]),
    st.integers(0, 2**32 - 1),
)
def test_every_pixel_gets_its_weighted_median(height, width, channels, count, window, sigma_s, sigma_c, seed):
    labels, guide = scene(height, width, channels, count, seed)
    before = labels.copy()
    result = weighted_median(labels, guide, None, window, sigma_s, sigma_c)
    assert_medians(result, labels, guide, window, sigma_s, sigma_c)
    np.testing.assert_array_equal(labels, before)


@pytest.mark.parametrize(('window', 'size'), [(31, (40, 45)), (101, (12, 70))])
def test_large_windows(window, size):
    labels, guide = scene(*size, 1, 30, 7)
    result = weighted_median(labels, guide, None, window, 15.8, 0.175)
    some = np.random.default_rng(1).integers(0, size, (60, 2))
    for y, x in some:
        histogram = oracles.median_histogram(labels, guide, y, x, window, 15.8, 0.175)
        assert oracles.is_weighted_median(int(result[y, x]), histogram)


@pytest.mark.parametrize('channels', [1, 3])
def test_only_the_wanted_pixels_change_and_to_the_same(channels):
    labels, guide = scene(30, 40, channels, 20, 3)
    wanted = np.random.default_rng(4).random(labels.shape) < 0.3
    everywhere = weighted_median(labels, guide, None, 9, 3.0, 0.3)
    result = weighted_median(labels, guide, wanted, 9, 3.0, 0.3)
    np.testing.assert_array_equal(result, np.where(wanted, everywhere, labels))
    assert (everywhere != labels).mean() > 0.2


def test_a_constant_map_stays_and_a_lonely_label_goes():
    labels, guide = np.full((9, 9), 6, np.int32), np.zeros((1, 9, 9), np.float32)
    np.testing.assert_array_equal(weighted_median(labels, guide, None, 5, 2.0, 0.1), labels)
    labels[4, 4] = 60
    assert (weighted_median(labels, guide, None, 5, 2.0, 0.1) == 6).all()


def test_an_edge_of_the_guide_is_kept():
    guide = np.zeros((1, 9, 12), np.float32)
    guide[..., 6:] = 1
    labels = np.where(guide[0] > 0, 30, 10).astype(np.int32)
    labels[2, 3], labels[6, 8] = 30, 10
    np.testing.assert_array_equal(weighted_median(labels, guide, None, 7, 5.0, 0.1), np.where(guide[0] > 0, 30, 10))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.tuples(st.integers(1, 12), st.integers(1, 40)), st.sampled_from([1, 3, 9, 31, 101]),
       st.sampled_from([0.5, 4.0, 100.0]), st.sampled_from([0.01, 0.1, 5.0]), st.sampled_from([1, 3, 20, 300]),
       st.integers(0, 2**32 - 1))
def test_the_separable_median_is_the_literal_one(shape, window, sigma_s, sigma_c, end, seed):
    disparities = np.random.default_rng(seed).integers(0, end, shape).astype(np.int32)
    guide = (disparities / np.float32(end)).astype(np.float32)[None]
    literal = weighted_median(disparities, guide, None, window, sigma_s, sigma_c)
    separable = weighted_median_of_disparity(disparities, None, window, sigma_s, sigma_c, end)
    np.testing.assert_array_equal(separable, literal)


def test_the_separable_median_is_certain_nearly_everywhere():
    steps = np.sort(np.random.default_rng(1).integers(0, 60, (80, 90)), axis=1).astype(np.int32)
    scale = float(2**19)  # what weighted_median takes for this window
    medians, certain = separable_median(steps, 31, 15.8, 0.175 * 64, scale)
    assert certain.mean() > 0.98 and (medians != steps).any()


def test_a_tie_is_left_to_the_whole_weights():
    """Two labels of equal weight: float32 sums must not decide."""
    labels = np.array([[0, 5]], np.int32)
    assert not separable_median(labels, 3, 1e6, 1e6, 2.0**25)[1].all()
    assert weighted_median_of_disparity(labels, None, 3, 1e6, 1e6, 1).tolist() == [[0, 0]]
