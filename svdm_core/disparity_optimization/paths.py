"""Stage 3, semi-global: costs smoothed along scanlines from three or four sides (Hirschmueller 2008), in bytes.

L(p, d) = C(p, d) + min(L(q, d), L(q, d +- 1) + P1, min L(q) + P2(q, p)) - min L(q), q the pixel before p. Sums of three
paths, and halved ones of four, saturate: what is at the limit is so bad that it does not win. All disparities of a
pixel are one vector.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..kernels.arrays import Float32, Int16, Uint8
from ..kernels.compilation import kernel
from ..kernels.vectors import pointer
from ..kernels.wide import (
    UNIT,
    Lanes,
    add_saturated,
    average,
    first_equal_wide,
    lanes_above,
    lanes_below,
    least_wide,
    load_wide,
    minimum_wide,
    splat_wide,
    store_wide,
    subtract_saturated,
)

FROM_LEFT, ADDED, AVERAGED = 0, 1, 2
"""What `along_rows` does."""

ROWS = 4
"""Rows smoothed along at a time: the instructions of one need not wait for those of its neighbour."""


@kernel
def _step(same: Any, cost: Any, low: np.uint8, smooth: Any, jump: np.uint8, lanes: Lanes) -> Any:
    """L of a pixel: same and low, L of the pixel before and its minimum; smooth and jump, P1 and P2 of the step."""
    base = splat_wide(low, lanes)
    beside = add_saturated(minimum_wide(lanes_below(same), lanes_above(same)), smooth)
    best = minimum_wide(minimum_wide(same, beside), add_saturated(base, splat_wide(jump, lanes)))
    return add_saturated(cost, subtract_saturated(best, base))


@kernel
def along_rows(
    costs: Uint8, rows: int, width: int, p1: np.uint8, p2: Uint8, way: int, sums: Uint8, lanes: Lanes
) -> None:
    """Path costs of up to ROWS rows at once: those from the left (way FROM_LEFT), or combined with them those from the
    right: ADDED, or where there are four paths AVERAGED.

    costs: uint8 (rows * W * lanes); p2: uint8, one for each pixel (its step from the left), and one more; sums: uint8
    (ROWS * W * lanes), of which rows that are not there get numbers without meaning.
    """
    cost, to, jump = pointer(costs), pointer(sums), pointer(p2)
    step, smooth, row = UNIT * len(lanes), splat_wide(p1, lanes), width * UNIT * len(lanes)
    b_row, c_row, d_row = min(1, rows - 1), min(2, rows - 1), min(3, rows - 1)
    a = splat_wide(np.uint8(0), lanes)
    b, c, d = a, a, a
    low_a, low_b, low_c, low_d = np.uint8(0), np.uint8(0), np.uint8(0), np.uint8(0)
    for k in range(width):
        x = k if way == FROM_LEFT else width - 1 - k
        o, there = x * step, x if way == FROM_LEFT else x + 1
        a = _step(a, load_wide(cost, o, lanes), low_a, smooth, jump[there], lanes)
        _put(a, way, to, o, lanes)
        low_a = least_wide(a)
        b = _step(b, load_wide(cost, o + b_row * row, lanes), low_b, smooth, jump[b_row * width + there], lanes)
        _put(b, way, to, o + row, lanes)
        low_b = least_wide(b)
        c = _step(c, load_wide(cost, o + c_row * row, lanes), low_c, smooth, jump[c_row * width + there], lanes)
        _put(c, way, to, o + 2 * row, lanes)
        low_c = least_wide(c)
        d = _step(d, load_wide(cost, o + d_row * row, lanes), low_d, smooth, jump[d_row * width + there], lanes)
        _put(d, way, to, o + 3 * row, lanes)
        low_d = least_wide(d)


@kernel
def _put(path: Any, way: int, to: Any, at: int, lanes: Lanes) -> None:
    if way == ADDED:
        path = add_saturated(path, load_wide(to, at, lanes))
    elif way == AVERAGED:
        path = average(path, load_wide(to, at, lanes))
    store_wide(to, at, path)


class Line(NamedTuple):
    """Path costs of the last row of a path from above or below: uint8 (W * lanes), and their minima, uint8 (W)."""

    costs: Uint8
    low: Uint8


@kernel
def along_columns(costs: Uint8, p1: np.uint8, p2: Uint8, line: Line, into: Uint8, lanes: Lanes) -> None:
    """One row of the paths from above, or from below; into: where it is wanted, uint8 (W * lanes), else empty.

    p2: uint8 (W), of the steps to this row's pixels.
    """
    cost, last, low, jump, to = pointer(costs), pointer(line.costs), pointer(line.low), pointer(p2), pointer(into)
    smooth, step = splat_wide(p1, lanes), UNIT * len(lanes)
    for x in range(line.low.size):
        path = _step(load_wide(last, x * step, lanes), load_wide(cost, x * step, lanes), low[x], smooth, jump[x], lanes)
        store_wide(last, x * step, path)
        low[x] = least_wide(path)
        if into.size > 0:
            store_wide(to, x * step, path)


class Masks(NamedTuple):
    """Sums to be left out, 255 where they are: barrier, uint8 (lanes), behind the search range; rivals, uint8
    (2 * lanes + 2), which from place lanes - d on leaves out d - 1, d and d + 1."""

    barrier: Uint8
    rivals: Uint8


def masks_of(num_disparities: int, lanes: int) -> Masks:
    """For vectors of `lanes`."""
    place = np.arange(2 * lanes + 2)
    return Masks(np.where(place[:lanes] < num_disparities, 0, 255).astype(np.uint8),
                 np.where(abs(place - lanes) <= 1, 255, 0).astype(np.uint8))


class RowWinners(NamedTuple):
    """Of one row. disparity: int16 (W), from the start of the search range. margin: uint8 (W), 255 times what the best
    rival's sum is above the winner's, in winner's sums, at most 255; or empty where it is not wanted. lowest: scratch,
    uint8 (W), the winner's sums."""

    disparity: Int16
    margin: Uint8
    lowest: Uint8


@kernel
def take_winners(
    costs: Uint8, steps: tuple[np.uint8, Uint8], line: Line, sums: Uint8, more: Uint8, masks: Masks,
    winners: RowWinners, lanes: Lanes,
) -> None:
    """The last path, from above, and the winners of one row: the disparities of the smallest sums.

    steps: P1, and P2 as in `along_columns`. sums: those of the paths along rows, which become those of all; more: uint8
    (W * lanes), those from below, or empty; with them, sums are halved. A rival lies beyond the winner's neighbours.
    """
    cost, last, low, jump, to = pointer(costs), pointer(line.costs), pointer(line.low), pointer(steps[1]), pointer(sums)
    third, best, added, step = pointer(more), pointer(winners.disparity), more.size > 0, UNIT * len(lanes)
    smooth, behind = splat_wide(steps[0], lanes), load_wide(pointer(masks.barrier), 0, lanes)
    rivals, margin, measured = pointer(masks.rivals), pointer(winners.margin), winners.margin.size > 0
    lowest = pointer(winners.lowest)
    for x in range(line.low.size):
        o = x * step
        path = _step(load_wide(last, o, lanes), load_wide(cost, o, lanes), low[x], smooth, jump[x], lanes)
        store_wide(last, o, path)
        low[x] = least_wide(path)
        if added:
            path = average(path, load_wide(third, o, lanes))
        total = add_saturated(path, load_wide(to, o, lanes))
        store_wide(to, o, total)
        total = total | behind
        least = least_wide(total)
        d = first_equal_wide(total, least)
        best[x] = np.int16(d)
        if measured:
            lowest[x] = least
            margin[x] = least_wide(total | load_wide(rivals, step - d, lanes))
    if measured:
        _fill_margins(winners.lowest, winners.margin)


@kernel
def _fill_margins(lowest: Uint8, margin: Uint8) -> None:
    """margin: the rivals' sums, replaced."""
    for x in range(margin.size):
        least = np.float32(lowest[x])
        above = (np.float32(margin[x]) - least) / max(least, np.float32(1))
        margin[x] = np.uint8(np.float32(255) * min(above, np.float32(1)))


@kernel
def fill_vertices(sums: Uint8, winner: Int16, num_disparities: int, vertex: Float32, lanes: Lanes) -> None:
    """vertex[x]: `symmetric_v` of the winner's sum and its neighbours', 0 at either end of the search range."""
    for x in range(winner.size):
        d: Any = np.int64(winner[x])
        at = x * UNIT * len(lanes) + d
        below, lowest = np.float32(sums[max(at - 1, 0)]), np.float32(sums[at])
        above = np.float32(sums[min(at + 1, sums.size - 1)])
        inside = np.float32(d > 0) * np.float32(d < num_disparities - 1)
        slope = max(max(below, above) - lowest, np.float32(1))  # sums are whole numbers
        vertex[x] = inside * (np.float32(0.5) * (below - above) / slope)
