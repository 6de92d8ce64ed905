import numpy as np
import oracles
import pytest
from stages import run, task_phase

from svdm_core.disparity_refinement import byte_median


def finished(filled, guide, valid, vertex, w_p, sigma_s, sigma_c, count):
    """The map in 1/64 px; guide: uint8 (C, H, W)."""
    height, width = filled.shape
    labels, margins = byte_median.empty_maps((height, width, len(guide)), w_p)
    maps = byte_median.MedianMaps(labels, margins, valid, filled, vertex, np.full(filled.shape, 9, np.uint16))
    window = byte_median.median_window(width, w_p, sigma_s, sigma_c, count)
    tasks = -(-height // byte_median.ROWS)
    run(task_phase(tasks, byte_median.fill_margins, maps, w_p, guide),
        task_phase(tasks, byte_median.take_medians, maps, window, byte_median.window_lanes(w_p),
                   scratch=byte_median.scratch_size(w_p)))
    return maps.fixed


def scene(shape, channels, count, spread=3):
    """Surfaces with steps of labels and guide in the same places, and labels spread over so many disparities."""
    rng = np.random.default_rng(0)
    steps = rng.integers(0, count, -(-shape[1] // 5)).repeat(5)[:shape[1]]
    filled = (steps + rng.integers(0, spread, shape)).clip(0, count - 1).astype(np.int16)
    guide = (steps * 200 // count + rng.integers(0, 50, (channels, *shape))).astype(np.uint8)
    return filled, guide


@pytest.mark.parametrize('channels', [1, 3])
@pytest.mark.parametrize(('shape', 'count', 'w_p', 'sigma_s', 'sigma_c'), [
    ((40, 37), 60, 11, 8.0, 0.1), ((25, 40), 256, 21, 14.0, 0.1), ((20, 70), 31, 41, 24.0, 0.08),
    ((30, 31), 9, 3, 0.5, 0.02), ((30, 31), 2, 5, 1000.0, 100.0),
])
def test_medians_are_those_of_the_equations_but_for_two_in_a_hundred(shape, count, w_p, sigma_s, sigma_c, channels):
    filled, guide = scene(shape, channels, count)
    nothing = np.zeros(shape, np.bool_)
    fixed = finished(filled, guide, nothing, np.zeros((0, 0), np.float32), w_p, sigma_s, sigma_c, count)
    assert (fixed % byte_median.STEPS == 0).all()
    apart = apart_from_the_equations(fixed, filled, guide / 255, w_p, sigma_s, sigma_c)
    assert (apart > 0).mean() < 0.02


def test_medians_of_labels_that_are_spread_evenly_are_others_by_one_label_mostly():
    """32 labels as likely as each other: a share of 1.5 % of the weight lies between two medians."""
    filled, guide = scene((25, 40), 1, 256, spread=32)
    fixed = finished(filled, guide, np.zeros((25, 40), np.bool_), np.zeros((0, 0), np.float32), 21, 14.0, 0.1, 256)
    apart = apart_from_the_equations(fixed, filled, guide / 255, 21, 14.0, 0.1)
    assert (apart > 0).mean() < 0.07 and apart.max() <= 3


def apart_from_the_equations(fixed, filled, guide, w_p, sigma_s, sigma_c):
    """Of some pixels, how many disparities the median is off; 0 where rounding in float32 could make it another."""
    apart = []
    for y, x in np.random.default_rng(1).integers(0, filled.shape, (400, 2)):
        histogram = oracles.median_histogram(filled, guide, y, x, w_p, sigma_s, sigma_c, 1 if w_p <= 7 else 2)
        found = int(fixed[y, x]) // byte_median.STEPS
        medians = [label for label in histogram if oracles.is_weighted_median(label, histogram)]
        apart.append(min(abs(found - label) for label in medians))
    return np.array(apart)


@pytest.mark.parametrize('shape', [(1, 1), (1, 9), (9, 1), (6, 7)])
@pytest.mark.parametrize('w_p', [1, 3, 21, 101])
def test_a_constant_map_stays_whatever_the_size(shape, w_p):
    filled, guide = np.full(shape, 255, np.int16), np.random.default_rng(1).integers(0, 256, (1, *shape), np.uint8)
    fixed = finished(filled, guide, np.zeros(shape, np.bool_), np.zeros((0, 0), np.float32), w_p, 9.0, 0.1, 256)
    assert (fixed == 255 * byte_median.STEPS).all()


def test_valid_pixels_keep_their_disparity_with_its_sub_pixel_part():
    filled, guide = scene((12, 17), 1, 60)
    vertex = np.random.default_rng(2).uniform(-0.5, 0.5, filled.shape).astype(np.float32)
    vertex[filled == 0] = 0
    valid = np.random.default_rng(3).random(filled.shape) < 0.6
    fixed = finished(filled, guide, valid, vertex, 5, 9.0, 0.1, 60)
    everywhere = finished(filled, guide, ~valid, vertex, 5, 9.0, 0.1, 60)
    kept = np.rint((filled + vertex) * np.float32(64))
    np.testing.assert_array_equal(fixed[valid], kept[valid])
    np.testing.assert_array_equal(everywhere[~valid], kept[~valid])
    whole = finished(filled, guide, valid, np.zeros((0, 0), np.float32), 5, 9.0, 0.1, 60)
    np.testing.assert_array_equal(whole[valid], 64 * filled[valid])
    np.testing.assert_array_equal(whole[~valid], fixed[~valid])


def test_an_edge_of_the_guide_is_kept_and_a_lonely_label_goes():
    guide = np.zeros((1, 9, 12), np.uint8)
    guide[..., 6:] = 255
    filled = np.where(guide[0] > 0, 30, 10).astype(np.int16)
    expected = 64 * filled
    filled[2, 3], filled[6, 8] = 30, 10
    fixed = finished(filled, guide, np.zeros(filled.shape, np.bool_), np.zeros((0, 0), np.float32), 7, 5.0, 0.1, 64)
    np.testing.assert_array_equal(fixed, expected)


def test_of_wide_windows_every_second_row_is_taken_around_the_pixels_own():
    assert byte_median.window_rows(7).tolist() == [-3, -2, -1, 0, 1, 2, 3]
    assert byte_median.window_rows(9).tolist() == [-4, -2, 0, 2, 4]
    assert byte_median.window_rows(11).tolist() == [-4, -2, 0, 2, 4]
