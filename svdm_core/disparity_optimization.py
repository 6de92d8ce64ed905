"""Stage 3, disparity optimisation: the winner takes all (eq 14), kept up while blocks of disparities come in."""
from __future__ import annotations

import dataclasses

import numba
import numpy as np

from .arrays import Float32, Int32, Int64
from .matching_cost import BLOCK

# A cost and its disparity in one integer: the bits of a float32 >= 0 order like the float, so the smallest key is
# the smallest cost, at the smallest disparity among equals, and minima need no branch.
_COST_BITS = np.int64(32)
_INDEX_MASK = np.int64(2**32 - 1)
_NO_KEY = np.int64(2**63 - 1)

# Nodes worked on by one task.
_CHUNK = 4096


@dataclasses.dataclass(frozen=True, slots=True)
class Winners:
    """The best disparity of each node so far.

    key: int64 (2, N), per view the bits of the smallest cost << 32 | its disparity - min_disparity.
    below, above: float32 (N,), left view: the costs one disparity beside the winner, for the parabola.
    last: float32 (N,), left view: the cost at the last disparity seen.
    """

    key: Int64
    below: Float32
    above: Float32
    last: Float32

    @classmethod
    def empty(cls, nodes: int) -> Winners:
        """Room for two views of `nodes` nodes."""
        return cls(np.full((2, nodes), _NO_KEY), *np.zeros((3, nodes), np.float32))

    def reset(self) -> None:
        """Forget all disparities seen."""
        self.key.fill(_NO_KEY)

    def update(self, cost: Float32, first: int, count: int, subpixel: bool = True) -> None:
        """Let the disparities first .. first + count - 1 compete: cost (2, blocks, N, BLOCK), all >= 0.

        Blocks must come in the order of their disparities. Without `subpixel` the neighbours are not kept.
        """
        _update(cost, first, count, subpixel, self.key, self.below, self.above, self.last)

    def images(self, pixel: Int32, shape: tuple[int, int], num_disparities: int) -> tuple[Int32, Float32]:
        """The result in image order: winners and the left view's sub-pixel offsets.

        pixel: int32 (2, N), pixel of each node, the right view's mirrored. Returns int32 (2, H, W), disparity -
        min_disparity, neither view mirrored; and float32 (H, W), the vertex of the parabola through the winner's
        cost and its neighbours', -0.5 .. 0.5 px, 0 at either end of the search range.
        """
        winner = np.empty((2, *shape), np.int32)
        vertex = np.empty(shape, np.float32)
        cost = (self.key[0] >> _COST_BITS).astype(np.int32).view(np.float32)
        _images(pixel, self.key, cost, self.below, self.above, num_disparities - 1, winner, vertex)
        return winner, vertex


@numba.njit(cache=True)
def _smallest_keys(rows: Float32, first: int, count: int, key: Int64) -> None:
    """One block: rows (n, BLOCK), of which the first `count` disparities compete; key (n,)."""
    for k in range(key.size):
        bits = rows[k].view(np.int32)
        smallest = key[k]
        for j in range(count):
            smallest = min(smallest, np.int64(bits[j]) << _COST_BITS | np.int64(first + j))
        key[k] = smallest


@numba.njit(cache=True)
def _keep_neighbours(
    rows: Float32, first: int, count: int, before: Int64, key: Int64, below: Float32, above: Float32, last: Float32
) -> None:
    """Costs beside the winner, where it is in this block or was at the end of the one before."""
    for k in range(key.size):
        row = rows[k]
        if before[k] & _INDEX_MASK == first - 1:
            above[k] = row[0]
        if key[k] != before[k]:
            j = (key[k] & _INDEX_MASK) - first
            below[k] = row[j - 1] if j > 0 else last[k]
            above[k] = row[min(j + 1, count - 1)]
        last[k] = row[count - 1]


@numba.njit(cache=True, parallel=True)
def _update(
    cost: Float32, first: int, count: int, subpixel: bool, key: Int64, below: Float32, above: Float32, last: Float32
) -> None:
    blocks, nodes = cost.shape[1:3]
    for chunk in numba.prange(-(-nodes // _CHUNK)):
        start, stop = chunk * _CHUNK, min(nodes, (chunk + 1) * _CHUNK)
        for block in range(blocks):
            here = first + block * BLOCK
            competing = min(BLOCK, first + count - here)
            if competing > 0:
                rows, best = cost[0, block, start:stop], key[0, start:stop]
                before = best.copy()
                _smallest_keys(rows, here, competing, best)
                if subpixel:
                    _keep_neighbours(rows, here, competing, before, best, below[start:stop], above[start:stop],
                                     last[start:stop])
                _smallest_keys(cost[1, block, start:stop], here, competing, key[1, start:stop])


@numba.njit(cache=True, inline='always')
def _parabola(below: np.float32, best: np.float32, above: np.float32) -> np.float32:
    bend = below - np.float32(2) * best + above
    if bend <= 0:
        return np.float32(0)
    return min(max(np.float32(0.5) * (below - above) / bend, np.float32(-0.5)), np.float32(0.5))


@numba.njit(cache=True, parallel=True)
def _images(
    pixel: Int32, key: Int64, cost: Float32, below: Float32, above: Float32, end: int, winner: Int32, vertex: Float32
) -> None:
    nodes, width = pixel.shape[1], vertex.shape[1]
    for chunk in numba.prange(-(-nodes // _CHUNK)):
        for k in range(chunk * _CHUNK, min(nodes, (chunk + 1) * _CHUNK)):
            y, x = divmod(pixel[1, k], width)
            winner[1, y, width - 1 - x] = key[1, k] & _INDEX_MASK
            y, x = divmod(pixel[0, k], width)
            index = key[0, k] & _INDEX_MASK
            winner[0, y, x] = index
            inside = 0 < index < end
            vertex[y, x] = _parabola(below[k], cost[k], above[k]) if inside else np.float32(0)
