import numpy as np
import oracles
import pytest
from stages import run, task_phase

from svdm_core.disparity_refinement import far_filling


def filled_from_afar(labels, valid, levels, count, threads=1):
    """int16 (H, W) labels, filled along rows before; levels: uint8 (C, H, W)."""
    told = np.full((len(valid), valid.shape[1] + 2), -9, np.int32)
    for row, to in zip(valid, told, strict=True):
        found = np.array(oracles.runs(~row), np.int32).reshape(-1)
        to[0], to[1:1 + found.size] = found.size // 2, found
    gaps = far_filling.Gaps(valid, oracles.fill(labels, valid), told, levels)
    shape = (*valid.shape, 3) if len(levels) == 3 else valid.shape
    far, window = far_filling.empty_far_maps(shape, count), far_filling.far_window(count, 1.0)
    run(task_phase(far_filling.sampled_rows(far), far_filling.fill_far_maps, far, window, gaps),
        task_phase(-(-len(valid) // far_filling.ROWS), far_filling.fill_from_afar, far, window, gaps,
                   scratch=far_filling.scratch_size(valid.shape[1])), threads=threads)
    return gaps.filled


def scene(shape, count, channels, seed=0):
    """Surfaces of one label and one grey level each; half of the pixels are not valid, in runs."""
    rng = np.random.default_rng(seed)
    surface = rng.integers(0, 4, (shape[0] // 6 + 1, shape[1] // 9 + 1)).repeat(6, 0).repeat(9, 1)
    surface = surface[:shape[0], :shape[1]]
    labels = rng.integers(0, count, 4)[surface].astype(np.int16)
    levels = np.stack([rng.integers(0, 256, 4)[surface] for _ in range(channels)])
    levels = (levels + rng.integers(0, 6, levels.shape)).clip(0, 255).astype(np.uint8)
    return labels, rng.random((shape[0], -(-shape[1] // 7))).repeat(7, 1)[:, :shape[1]] < 0.5, levels


@pytest.mark.parametrize(('shape', 'count', 'channels'), [
    ((1, 1), 1, 1), ((1, 40), 16, 1), ((30, 5), 64, 3), ((31, 60), 5, 1), ((24, 70), 64, 3), ((9, 50), 1024, 1),
    ((40, 41), 33, 1)])
def test_borders_and_gaps_at_depth_edges_get_the_median_of_the_sparse_window(shape, count, channels):
    labels, valid, levels = scene(shape, count, channels)
    filled = filled_from_afar(labels, valid, levels, count)
    along_rows, column = oracles.fill(labels, valid), -(-count // 16)
    np.testing.assert_array_equal(filled[valid], labels[valid])
    compared = 0
    for y in range(0, shape[0], 2):  # odd rows take the medians of the row above where it has any
        for start, end in oracles.runs(~valid[y]):
            at_edge = start > 0 and end < shape[1] and abs(int(labels[y, start - 1]) - labels[y, end]) > 3
            for x in range(start, end):
                first = x // column * column
                if (first < start or first + column > end) and 1 < column < 64:
                    continue  # two runs may share a column, and what was found for the first of them
                first, last = max(start, first), min(end, first + column)
                middle = min(max(x // column * column + column // 2, first), last - 1)
                histogram = oracles.far_histogram(labels, valid, levels / 255, y, middle, column)
                weight = sum(histogram.values())
                known = weight > 0.05
                if abs(weight - 0.05) < 0.01:
                    continue
                if start > 0 and not (at_edge and known):
                    assert filled[y, x] == along_rows[y, x]
                elif start > 0:
                    medians = [m for m in histogram if oracles.is_weighted_median(m, histogram, 0.02)]
                    assert filled[y, x] in [min(m, along_rows[y, x]) for m in medians]
                    compared += 1
                elif known:
                    medians = [m for m in histogram if oracles.is_weighted_median(m, histogram, 0.1)]
                    assert min(abs(filled[y, x] - m) for m in medians) <= 3  # where the line through the row leads
    assert compared > 0 or shape[1] < 41 or not 10 < count < 1000


def test_a_border_is_filled_by_what_looks_like_it_and_goes_on_along_its_plane():
    """A wall that comes nearer to the right, in front of it on the left a dark thing which both cameras see, above."""
    levels = np.full((1, 60, 200), 200, np.uint8)
    wall = np.round(20 + 0.06 * np.arange(200)).astype(np.int16)
    labels = np.tile(wall, (60, 1))
    levels[0, :30, :70], labels[:30, :70] = 20, 50
    valid = np.ones(labels.shape, np.bool_)
    valid[30:, :40] = False
    labels[30:, 40:48], levels[0, 30:, 40:48] = 50, 20  # the nearest valid pixels are dark
    filled = filled_from_afar(labels, valid, levels, 64)
    assert (oracles.fill(labels, valid)[30:, :40] == 50).all()
    assert np.abs(filled[30:, :40] - wall[48]).max() <= 5  # the wall, not the thing
    labels[30:, 40:48], levels[0, 30:, 40:48] = wall[40:48], 200
    filled = filled_from_afar(labels, valid, levels, 64)
    falling = filled[45, :40].astype(int)
    assert falling[0] < falling[20] < falling[39] and abs(falling[39] - wall[39]) <= 1


def test_a_row_without_a_valid_pixel_takes_what_is_above_and_nothing_is_made_up_where_nothing_is_known():
    labels = np.full((40, 60), 9, np.int16)
    valid = np.ones(labels.shape, np.bool_)
    labels[20], valid[20] = 3, False
    levels = np.full((1, 40, 60), 100, np.uint8)
    assert (filled_from_afar(labels, valid, levels, 16) == 9).all()
    np.testing.assert_array_equal(filled_from_afar(labels, np.zeros_like(valid), levels, 16), labels)


def test_any_number_of_threads_fills_alike():
    labels, valid, levels = scene((90, 80), 64, 3, seed=5)
    one, three = (filled_from_afar(labels, valid, levels, 64, threads) for threads in (1, 3))
    np.testing.assert_array_equal(one, three)


@pytest.mark.parametrize('count', [60, 64, 256, 1024])
def test_the_line_does_not_lead_out_of_the_search_range(count):
    """A wall that comes nearer to the left, up to the nearest disparity there is."""
    labels = np.tile(np.round(count - 1 - 0.1 * np.arange(200)).astype(np.int16), (40, 1))
    valid = np.ones(labels.shape, np.bool_)
    valid[:, :25] = False
    labels[:, 25:] = labels[:, :-25]
    filled = filled_from_afar(labels, valid, np.full((1, 40, 200), 100, np.uint8), count)
    assert count - 9 <= filled[:, :25].min() and filled[:, :25].max() <= count - 1
