"""The paths along rows and columns, winners and vertices of rows, against plain loops that cut off at 255."""
import numpy as np
import oracles
import pytest

from svdm_core.disparity_optimization import paths
from svdm_core.kernels.wide import lanes_for, width_of

P1 = 9
KINDS = ['random', 'near the limit', 'constant', 'ties']
SIZES = [(1, 1, 32), (4, 1, 33), (1, 9, 32), (2, 7, 33), (3, 6, 32), (4, 11, 64)]


def scene(kind, rows, width, count):
    """(lanes, costs (rows, W, lanes), P2 of the steps (rows, W))."""
    rng, lanes = np.random.default_rng(rows + width), lanes_for(count)
    shape = rows, width, width_of(lanes)
    costs = {'random': rng.integers(0, 79, shape), 'near the limit': rng.integers(200, 256, shape),
             'constant': np.full(shape, 40), 'ties': rng.integers(0, 3, shape) * 20}[kind]
    return lanes, costs.astype(np.uint8), rng.integers(P1, 200, (rows, width)).astype(np.uint8)


def expected_paths(costs, step, p2):
    return oracles.path_costs(costs.astype(int), step, P1, p2.astype(int))


def with_one_more(p2):
    """As it lies in memory: the step behind the last pixel has no meaning."""
    return np.append(p2, np.uint8(1)).astype(np.uint8)


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(('rows', 'width', 'count'), SIZES)
def test_paths_along_rows_are_those_of_the_recurrence(rows, width, count, kind):
    lanes, costs, p2 = scene(kind, rows, width, count)
    row = width * width_of(lanes)
    sums = np.full((2, paths.ROWS * row), 99, np.uint8)
    for to, way in zip(sums, (paths.ADDED, paths.AVERAGED), strict=True):
        for each in (paths.FROM_LEFT, way):
            paths.along_rows(costs.reshape(-1), rows, width, np.uint8(P1), with_one_more(p2), each, to, lanes)
    # rows are apart from each other: one at a time, so that no path comes from above
    left, right = (np.concatenate([expected_paths(costs[k:k + 1], step, p2[k:k + 1]) for k in range(rows)])
                   for step in ((0, 1), (0, -1)))
    added, averaged = (part[:rows * row].reshape(costs.shape) for part in sums)
    np.testing.assert_array_equal(added, np.minimum(left + right, 255))
    np.testing.assert_array_equal(averaged, (left + right + 1) // 2)


def empty_line(width, lanes):
    return paths.Line(np.zeros(width * width_of(lanes), np.uint8), np.zeros(width, np.uint8))


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(('rows', 'width', 'count'), SIZES)
def test_paths_along_columns_are_those_of_the_recurrence(rows, width, count, kind):
    lanes, costs, p2 = scene(kind, rows, width, count)
    line, found = empty_line(width, lanes), np.zeros_like(costs)
    for y in range(rows):
        into = found[y].reshape(-1) if y % 2 == 0 else np.zeros(0, np.uint8)
        paths.along_columns(costs[y].reshape(-1), np.uint8(P1), p2[y], line, into, lanes)
        assert y % 2 or (found[y].min(axis=1) == line.low).all()
    expected = expected_paths(costs, (1, 0), p2)
    np.testing.assert_array_equal(found[::2], expected[::2])
    np.testing.assert_array_equal(line.costs.reshape(width, -1), expected[-1])


@pytest.mark.parametrize('is_fourth', [False, True])
@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize(('rows', 'width', 'count'), SIZES)
def test_winners_are_the_first_smallest_sums_within_the_range(rows, width, count, kind, is_fourth):
    lanes, costs, p2 = scene(kind, rows, width, count)
    _, others, _ = scene('random', rows, width + 1, count)
    sums, below = others[:, :-1].copy(), others[:, 1:].copy()
    masks = paths.masks_of(count, width_of(lanes))
    winners = paths.RowWinners(np.full(width, 99, np.int16), *np.full((2, width), 99, np.uint8))
    unmeasured = winners._replace(disparity=np.full(width, 99, np.int16), margin=np.zeros(0, np.uint8))
    line, vertex = empty_line(width, lanes), np.full(width, 99, np.float32)
    expected = expected_paths(costs, (1, 0), p2)
    if is_fourth:
        expected = (expected + below + 1) // 2
    expected = np.minimum(expected + sums, 255)
    for y in range(rows):
        more = below[y].reshape(-1) if is_fourth else np.zeros(0, np.uint8)
        given = paths.Line(line.costs.copy(), line.low.copy()), sums[y].reshape(-1).copy()
        paths.take_winners(costs[y].reshape(-1), (np.uint8(P1), p2[y]), line, sums[y].reshape(-1), more, masks,
                           winners, lanes)
        paths.take_winners(costs[y].reshape(-1), (np.uint8(P1), p2[y]), *given, more, masks, unmeasured, lanes)
        winner = winners.disparity
        paths.fill_vertices(sums[y].reshape(-1), winner, count, vertex, lanes)
        np.testing.assert_array_equal(sums[y], expected[y])
        np.testing.assert_array_equal(winner, expected[y, :, :count].argmin(axis=1))
        np.testing.assert_array_equal(unmeasured.disparity, winner)
        assert winners.margin.tolist() == [oracles.margin(pixel[:count]) for pixel in expected[y]]
        for x, d in enumerate(winner):
            inside = 0 < d < count - 1
            assert vertex[x] == pytest.approx(
                oracles.symmetric_v(*expected[y, x, d - 1:d + 2]) if inside else 0.0, abs=1e-6)
