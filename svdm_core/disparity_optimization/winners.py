"""Stage 3, disparity optimisation: the winner takes all (eq 14), kept up while blocks of disparities come in."""
from __future__ import annotations

import dataclasses

import numba
import numpy as np

from ..kernels.arrays import Float32, Int32
from ..kernels.compilation import kernel
from ..kernels.vectors import smallest

# Rows of `Winners.beside`: the costs one disparity below and above the winner, and at the ends of the slot's range.
_BELOW, _ABOVE, _FIRST, _LAST = range(4)

# Nodes worked on by one task.
_CHUNK = 4096


@dataclasses.dataclass(frozen=True, slots=True)
class Winners:
    """The best disparity of each node so far, in each of several ranges of disparities (slots) that run side by side.

    best: int32 (2, slots, N), bits of the smallest float32 cost >= 0, which order like the costs.
    index: int32 (2, slots, N), its disparity - min_disparity, the smallest among equal costs.
    beside: float32 (slots, 4, N), left view: costs one below and one above the winner, and at the slot's ends; or
    (slots, 4, 0): then there are no sub-pixel offsets.
    """

    best: Int32
    index: Int32
    beside: Float32

    @classmethod
    def empty(cls, slots: int, nodes: int, subpixel: bool = True) -> Winners:
        """Room for two views of `nodes` nodes; the first block of a slot overwrites what was there before."""
        best, index = np.zeros((2, 2, slots, nodes), np.int32)
        return cls(best, index, np.zeros((slots, 4, nodes if subpixel else 0), np.float32))

    def images(
        self, pixel: Int32, shape: tuple[int, int], num_disparities: int, per_slot: int
    ) -> tuple[Int32, Float32]:
        """The result in image order: winners and the left view's sub-pixel offsets.

        pixel: int32 (2, N), pixel of each node, the right view's mirrored. per_slot: disparities of a slot. Returns
        int32 (2, H, W), disparity - min_disparity, the right view still mirrored; and float32 (H, W), `symmetric_v` of
        the winner's cost and its neighbours', -0.5 .. 0.5 px, 0 at the ends of the search range.
        """
        winner = np.empty((2, *shape), np.int32)
        vertex = np.empty(shape, np.float32)
        _images(pixel, self.best, self.best.view(np.float32), self.index, self.beside, num_disparities - 1, per_slot,
                winner.reshape(2, -1), vertex.reshape(-1))
        return winner, vertex


@kernel
def take_smallest(row, rows, block, k, first, start, subpixel, best, index, beside, nodes):  # type: ignore[no-untyped-def]
    """Let the block of node k compete, whose first disparity is `first`; `start` is the first of its slot.

    row: its costs as a vector, infinite behind the search range. rows: pointer to where they lie from k * block on.
    best, index, beside: pointers to those of `Winners`, one slot of one view.
    """
    least, lane = smallest(row)
    here = k * block
    wins = first == start or least < best[k]
    if subpixel:
        if first == start:
            beside[_FIRST * nodes + k] = rows[here]
        elif index[k] == first - 1:
            beside[_ABOVE * nodes + k] = rows[here]
        if wins:
            beside[_BELOW * nodes + k] = rows[here + lane - 1] if lane > 0 else beside[_LAST * nodes + k]
            beside[_ABOVE * nodes + k] = rows[here + min(lane + 1, block - 1)]
        beside[_LAST * nodes + k] = rows[here + block - 1]
    if wins:
        best[k] = least
        index[k] = first + lane


@kernel
def symmetric_v(below: np.float32, best: np.float32, above: np.float32) -> np.float32:
    """Vertex of the V with equal slopes through three costs, the middle one the smallest: -0.5 .. 0.5 disparities.

    Costs that are sums of absolute differences are V-shaped; a parabola draws their vertices to whole disparities
    (Haller and Nedevschi 2012).
    """
    slope = max(below, above) - best
    return np.float32(0.5) * (below - above) / slope if slope > 0 else np.float32(0)


@kernel
def _best_slot(best: Int32, k: int) -> int:
    winner = 0
    for slot in range(1, best.shape[0]):
        if best[slot, k] < best[winner, k]:
            winner = slot
    return winner


@kernel(parallel=True)
def _images(
    pixel: Int32, best: Int32, cost: Float32, index: Int32, beside: Float32, end: int, per_slot: int, winner: Int32,
    vertex: Float32,
) -> None:
    nodes, slots = pixel.shape[1], best.shape[1]
    for chunk in numba.prange(-(-nodes // _CHUNK)):
        for k in range(chunk * _CHUNK, min(nodes, (chunk + 1) * _CHUNK)):
            winner[1, pixel[1, k]] = index[1, _best_slot(best[1], k), k]
            slot = _best_slot(best[0], k)
            d = index[0, slot, k]
            winner[0, pixel[0, k]] = d
            offset = np.float32(0)
            if 0 < d < end and beside.shape[2] > 0:
                at_start, at_end = d == slot * per_slot, d == (slot + 1) * per_slot - 1 and slot < slots - 1
                below = beside[slot - 1, _LAST, k] if at_start else beside[slot, _BELOW, k]
                above = beside[slot + 1, _FIRST, k] if at_end else beside[slot, _ABOVE, k]
                offset = symmetric_v(below, cost[0, slot, k], above)
            vertex[pixel[0, k]] = offset
