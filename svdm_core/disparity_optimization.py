"""Stage 3, disparity optimisation: the winner takes all (eq 14), kept up while blocks of disparities come in."""
from __future__ import annotations

import dataclasses

import numba
import numpy as np

from .arrays import Float32, Int32
from .matching_cost import BLOCK

# Costs are >= 0, so their bit patterns order like the costs; integer minima use the vector unit.
_NO_COST = np.int32(2**31 - 1)


@dataclasses.dataclass(frozen=True, slots=True)
class Winners:
    """The best disparity of each node so far, per view; all arrays (2, N).

    cost: int32, bits of the smallest float32 cost. index: int32, its disparity - min_disparity.
    below, above: float32, the costs one disparity beside it (left view only, for the parabola).
    last: float32, the cost at the last disparity seen.
    """

    cost: Int32
    index: Int32
    below: Float32
    above: Float32
    last: Float32

    @classmethod
    def empty(cls, nodes: int) -> Winners:
        """Room for two views of `nodes` nodes."""
        cost, index = np.zeros((2, 2, nodes), np.int32)
        below, above, last = np.zeros((3, 2, nodes), np.float32)
        return cls(cost, index, below, above, last)

    def reset(self) -> None:
        """Forget all disparities seen."""
        self.cost.fill(_NO_COST)

    def update(self, cost: Float32, first: int, count: int) -> None:
        """Let the disparities first .. first + count - 1 compete: cost (2, blocks, N, BLOCK)."""
        parts = max(1, numba.get_num_threads() // 2)
        _update(cost, first, count, parts, self.cost, self.index, self.below, self.above, self.last)

    def images(
        self, pixel: Int32, shape: tuple[int, int], num_disparities: int
    ) -> tuple[Int32, Float32]:
        """The result in image order: winners and the left view's sub-pixel offsets.

        pixel: int32 (2, N), pixel of each node, the right view's mirrored. Returns int32 (2, H, W), disparity -
        min_disparity, neither view mirrored; and float32 (H, W), the vertex of the parabola through the winner's
        cost and its neighbours', -0.5 .. 0.5 px, 0 at either end of the search range.
        """
        winner = np.empty((2, *shape), np.int32)
        vertex = np.empty(shape, np.float32)
        best = self.cost.view(np.float32)
        _images(pixel, self.index, best[0], self.below[0], self.above[0], num_disparities - 1, winner, vertex)
        return winner, vertex


@numba.njit(cache=True, inline='always')
def _smallest(bits: Int32, count: int) -> np.int32:
    smallest = _NO_COST
    for j in range(count):
        smallest = min(smallest, bits[j])
    return smallest


@numba.njit(cache=True)
def _update_nodes(
    rows: Float32, first: int, count: int, best: Int32, index: Int32, below: Float32, above: Float32, last: Float32,
) -> None:
    """One block, one view: rows (N, BLOCK), of which the first `count` disparities compete. Ties keep the smaller."""
    for k in range(best.size):
        row = rows[k]
        bits = row.view(np.int32)
        if index[k] == first - 1:
            above[k] = row[0]
        smallest = _smallest(bits, count)
        if smallest < best[k]:
            j = 0
            while bits[j] != smallest:
                j += 1
            best[k] = smallest
            index[k] = first + j
            below[k] = row[j - 1] if j > 0 else last[k]
            above[k] = row[min(j + 1, count - 1)]
        last[k] = row[count - 1]


@numba.njit(cache=True, parallel=True)
def _update(
    cost: Float32, first: int, count: int, parts: int, best: Int32, index: Int32, below: Float32, above: Float32,
    last: Float32,
) -> None:
    views, blocks, nodes, _ = cost.shape
    for task in numba.prange(views * parts):
        view, part = task // parts, task % parts
        start, stop = part * nodes // parts, (part + 1) * nodes // parts
        for block in range(blocks):
            here = first + block * BLOCK
            left = min(BLOCK, first + count - here)
            if left > 0:
                _update_nodes(cost[view, block, start:stop], here, left, best[view, start:stop],
                              index[view, start:stop], below[view, start:stop], above[view, start:stop],
                              last[view, start:stop])


@numba.njit(cache=True, inline='always')
def _parabola(below: np.float32, best: np.float32, above: np.float32) -> np.float32:
    bend = below - np.float32(2) * best + above
    if bend <= 0:
        return np.float32(0)
    return min(max(np.float32(0.5) * (below - above) / bend, np.float32(-0.5)), np.float32(0.5))


@numba.njit(cache=True, parallel=True)
def _images(
    pixel: Int32, index: Int32, best: Float32, below: Float32, above: Float32, end: int, winner: Int32,
    vertex: Float32,
) -> None:
    width = vertex.shape[1]
    for view in numba.prange(2):
        for k in range(pixel.shape[1]):
            y, x = pixel[view, k] // width, pixel[view, k] % width
            if view == 1:
                winner[1, y, width - 1 - x] = index[1, k]
            else:
                winner[0, y, x] = index[0, k]
                inside = 0 < index[0, k] < end
                vertex[y, x] = _parabola(below[k], best[k], above[k]) if inside else np.float32(0)
