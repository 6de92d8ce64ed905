"""Stage 3, disparity optimisation: the winner takes all (eq 14), kept up while blocks of disparities come in."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..kernels.arrays import Float32, Int16, Int32, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.tasks import do_tasks, share
from ..kernels.vectors import pointer, smallest
from ..matching_cost.float_costs import BLOCK

# Rows of `Winners.beside`: the costs one disparity below and above the winner, and at the ends of the slot's range.
_BELOW, _ABOVE, _FIRST, _LAST = range(4)

# Nodes worked on by one task.
_CHUNK = 4096


class Winners(NamedTuple):
    """What stages 1 to 3 give: left int16 (H, W), right int16 (rows, W), mirrored, disparity - min_disparity; row y of
    the left view meets row y // every of the right one. vertex: float32 (H, W), sub-pixel part, or (0, 0). margin:
    uint8 (H, W), of the left view, as in `paths.RowWinners`; or (0, 0) where it was not measured."""

    left: Int16
    right: Int16
    every: int
    vertex: Float32
    margin: Uint8


class BestSoFar(NamedTuple):
    """The best disparity of each node so far, in each of several ranges of disparities (slots) that run side by side.

    best: int32 (2, slots, N), bits of the smallest float32 cost >= 0, which order like the costs.
    disparity: int32 (2, slots, N), that of it - min_disparity, the smallest among equal costs.
    beside: float32 (slots, 4, N), left view: costs one below and one above the winner, and at the slot's ends; or
    (slots, 4, 0): then there are no sub-pixel offsets.
    """

    best: Int32
    disparity: Int32
    beside: Float32


def empty_best(slots: int, nodes: int, subpixel: bool = True) -> BestSoFar:
    """Room for two views of `nodes` nodes; the first block of a slot overwrites what was there before."""
    best, disparity = np.zeros((2, 2, slots, nodes), np.int32)
    return BestSoFar(best, disparity, np.zeros((slots, 4, nodes if subpixel else 0), np.float32))


def winners_of(
    winners: BestSoFar, pixel: Int32, shape: tuple[int, int], num_disparities: int, per_slot: int
) -> tuple[Int16, Int16, Float32]:
    """The result in image order: winners of both views, and the left view's sub-pixel offsets.

    pixel: int32 (2, N), pixel of each node, the right view's mirrored. per_slot: disparities of a slot. Returns
    int16 (H, W) twice, disparity - min_disparity, the right view still mirrored; and float32 (H, W), `symmetric_v` of
    the winner's cost and its neighbours', -0.5 .. 0.5 px, 0 at the ends of the search range.
    """
    winner = np.empty((2, *shape), np.int16)
    vertex = np.empty(shape, np.float32)
    images = _Images(winners.best.view(np.float32), winner.reshape(2, -1), vertex.reshape(-1))
    do_tasks(_fill_images, -(-pixel.shape[1] // _CHUNK), pixel, winners, (num_disparities - 1, per_slot), images)
    return winner[0], winner[1], vertex


class SlotPointers(NamedTuple):
    """`BestSoFar` of one slot of one view as pointers; start: its first disparity, nodes: how many there are."""

    best: Any
    disparity: Any
    beside: Any
    nodes: int
    start: int
    subpixel: bool


@kernel
def slot_pointers(winners: BestSoFar, view: int, slot: int, start: int, subpixel: bool) -> SlotPointers:
    """One slot of one view; subpixel: whether the costs beside the winner are kept."""
    return SlotPointers(pointer(winners.best[view, slot]), pointer(winners.disparity[view, slot]),
                        pointer(winners.beside[slot]), winners.best.shape[2], start, subpixel)


@kernel
def take_smallest(row: Any, rows: Any, k: int, first: int, kept: SlotPointers) -> None:
    """Let the block of node k compete, whose first disparity is `first`.

    row: its costs as a vector, infinite behind the search range. rows: pointer to where they lie from k * BLOCK on.
    """
    least, lane = smallest(row)
    here, nodes, beside = k * BLOCK, kept.nodes, kept.beside
    wins = first == kept.start or least < kept.best[k]
    if kept.subpixel:
        if first == kept.start:
            beside[_FIRST * nodes + k] = rows[here]
        elif kept.disparity[k] == first - 1:
            beside[_ABOVE * nodes + k] = rows[here]
        if wins:
            beside[_BELOW * nodes + k] = rows[here + lane - 1] if lane > 0 else beside[_LAST * nodes + k]
            beside[_ABOVE * nodes + k] = rows[here + min(lane + 1, BLOCK - 1)]
        beside[_LAST * nodes + k] = rows[here + BLOCK - 1]
    if wins:
        kept.best[k] = least
        kept.disparity[k] = first + lane


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


class _Images(NamedTuple):
    """winner: int16 (2, N), vertex: float32 (N), by pixel. cost: float32 (2, slots, N), `BestSoFar.best`."""

    cost: Float32
    winner: Int16
    vertex: Float32


@kernel
def _fill_images(
    counter: Int64, end: int, arenas: Uint8, pixel: Int32, winners: BestSoFar, limits: tuple[int, int], images: _Images
) -> None:
    share(_images_of_chunk, counter, end, arenas, (pixel, winners, limits, images))


@kernel
def _images_of_chunk(
    chunk: int, _arena: Uint8, pixel: Int32, winners: BestSoFar, limits: tuple[int, int], images: _Images
) -> None:
    end, per_slot = limits
    cost, winner, vertex = images
    for k in range(chunk * _CHUNK, min(pixel.shape[1], (chunk + 1) * _CHUNK)):
        winner[1, pixel[1, k]] = winners.disparity[1, _best_slot(winners.best[1], k), k]
        slot = _best_slot(winners.best[0], k)
        d = winners.disparity[0, slot, k]
        winner[0, pixel[0, k]] = d
        inside = 0 < d < end and winners.beside.shape[2] > 0
        vertex[pixel[0, k]] = _offset(winners, cost, slot, k, per_slot) if inside else np.float32(0)


@kernel
def _offset(winners: BestSoFar, cost: Float32, slot: int, k: int, per_slot: int) -> np.float32:
    """`symmetric_v` of node k of the left view; its neighbours may lie in the slots beside."""
    d, beside = winners.disparity[0, slot, k], winners.beside
    at_start, at_end = d == slot * per_slot, d == (slot + 1) * per_slot - 1 and slot < beside.shape[0] - 1
    below = beside[slot - 1, _LAST, k] if at_start else beside[slot, _BELOW, k]
    above = beside[slot + 1, _FIRST, k] if at_end else beside[slot, _ABOVE, k]
    return symmetric_v(below, cost[0, slot, k], above)
