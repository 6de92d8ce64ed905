"""Stage 3, semi-global, by stripes: one task smooths a stripe of one view and takes its winners.

The paths along rows are those of the whole image; those along columns begin OVERLAP rows outside the stripe. Costs
come from a volume where the aggregation has filled one; else they are summed over 3x3 boxes, for three paths a few
rows at a time, so that they stay in the cache, and for the fourth a stripe at a time.
"""
from __future__ import annotations

from typing import NamedTuple

from ..cost_aggregation.box import box_row
from ..kernels.arrays import Float32, Int16, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.stripes import OVERLAP, STRIPE, Rows, stripe_rows
from ..kernels.tasks import share, whole_lines
from ..kernels.wide import UNIT, Lanes
from ..matching_cost.byte_costs import ByteCosts
from .paths import (
    ADDED,
    AVERAGED,
    FROM_LEFT,
    ROWS,
    Line,
    Masks,
    RowWinners,
    along_columns,
    along_rows,
    fill_vertices,
    take_winners,
)
from .penalties import Penalties


class Views(NamedTuple):
    """Which rows of the views are matched, and where their costs come from.

    left_volume, right_volume: uint8 (rows * W * lanes), aggregated costs, or empty: then they are summed over boxes.
    paths: 3 or 4. The image has `height` rows, the right view is matched on `right_height` of them.
    """

    height: int
    right_height: int
    width: int
    every: int
    paths: int
    left_volume: Uint8
    right_volume: Uint8


class StripeWinners(NamedTuple):
    """What comes out: left int16 (H, W), right int16 (rows, W), mirrored, disparity - min_disparity; vertex float32
    (H, W), sub-pixel part of the left ones, or (0, 0) where it is not wanted. margin: uint8 (H, W), of the left ones,
    as in `RowWinners`."""

    left: Int16
    right: Int16
    vertex: Float32
    margin: Uint8
    masks: Masks
    num_disparities: int


def scratch_size(width: int, lanes: int, paths: int) -> int:
    """Bytes of scratch that a task takes."""
    row = whole_lines(width * lanes)
    stored = 0 if paths == 3 else (STRIPE + 2 * OVERLAP) + STRIPE
    return (3 + 2 * ROWS + 1 + stored) * row + 2 * whole_lines(width)


@kernel
def smooth_stripes(
    counter: Int64, end: int, arenas: Uint8, costs: ByteCosts, penalties: Penalties, views: Views,
    winners: StripeWinners, lanes: Lanes,
) -> None:
    """The stripes of the left view, then those of the right one."""
    share(_smooth_stripe, counter, end, arenas, (costs, penalties, views, winners, lanes))


class _Scratch(NamedTuple):
    ring: Uint8
    costs: Uint8
    sums: Uint8
    line: Line
    lowest: Uint8
    stored: Uint8
    below: Uint8


@kernel
def _divided(arena: Uint8, row: int, width: int, rows: int) -> _Scratch:
    """The arena of a thread; rows: of costs that are stored."""
    line, rest = arena[:row], arena[row:]
    ring, rest = rest[:3 * row], rest[3 * row:]
    costs, rest = rest[:ROWS * row], rest[ROWS * row:]
    sums, rest = rest[:ROWS * row], rest[ROWS * row:]
    low, rest = rest[:width], rest[(width + 63) // 64 * 64:]
    lowest, rest = rest[:width], rest[(width + 63) // 64 * 64:]
    return _Scratch(ring.reshape(3, row), costs, sums, Line(line, low), lowest, rest[:rows * row], rest[rows * row:])


@kernel
def _smooth_stripe(
    task: int, arena: Uint8, costs: ByteCosts, penalties: Penalties, views: Views, winners: StripeWinners, lanes: Lanes
) -> None:
    """Any stripe, by the way its costs come."""
    left = Rows(views.height, views.width, 1, 0)
    stripes = (views.height + STRIPE - 1) // STRIPE
    view = 0 if task < stripes else 1
    rows = left if view == 0 else Rows(views.right_height, views.width, views.every, views.every // 2)
    first, last = stripe_rows(rows, task if view == 0 else task - stripes)
    row, overlap = views.width * UNIT * len(lanes), OVERLAP // rows.every
    low, high = max(0, first - overlap), min(rows.height, last + overlap)
    volume = views.left_volume if view == 0 else views.right_volume
    way = _Way(view, rows.width, first, last, low, high, views.paths == 4)
    if volume.size > 0:
        scratch = _divided(arena, row, views.width, 0)
        _smooth_stored(volume[low * row:high * row], way, scratch, penalties, winners, lanes)
    elif views.paths == 3:
        scratch = _divided(arena, row, views.width, 0)
        _smooth_boxes(costs, rows, way, scratch, penalties, winners, lanes)
    else:
        scratch = _divided(arena, row, views.width, high - low)
        known = max(0, low - 1)
        for y in range(low, high):
            known = box_row(costs, view, rows, y, known, scratch.ring,
                            scratch.stored[(y - low) * row:(y - low + 1) * row], lanes)
        _smooth_stored(scratch.stored, way, scratch, penalties, winners, lanes)


class _Way(NamedTuple):
    """Rows first .. last - 1 of a view; the paths from above begin in row `low`, those from below, where they are
    wanted, in row high - 1. side: 0 is the left view."""

    side: int
    width: int
    first: int
    last: int
    low: int
    high: int
    from_below: bool


@kernel
def _start(line: Line) -> None:
    line.costs[:] = 0
    line.low[:] = 0


@kernel
def _smooth_boxes(
    costs: ByteCosts, rows: Rows, way: _Way, scratch: _Scratch, penalties: Penalties, winners: StripeWinners,
    lanes: Lanes,
) -> None:
    """Three paths; the costs of ROWS rows at a time."""
    row, known = way.width * UNIT * len(lanes), max(0, way.low - 1)
    p1 = penalties.p1_left if way.side == 0 else penalties.p1_right
    down = penalties.down[way.side]
    _start(scratch.line)
    for y in range(way.low, way.first):
        known = box_row(costs, way.side, rows, y, known, scratch.ring, scratch.costs[:row], lanes)
        along_columns(scratch.costs[:row], p1, down[y * way.width:], scratch.line, scratch.below[:0], lanes)
    for y in range(way.first, way.last, ROWS):
        count = min(ROWS, way.last - y)
        for k in range(count):
            known = box_row(costs, way.side, rows, y + k, known, scratch.ring,
                            scratch.costs[k * row:(k + 1) * row], lanes)
        _finish_rows(scratch.costs, y, count, way, scratch, penalties, winners, lanes)


@kernel
def _smooth_stored(
    costs: Uint8, way: _Way, scratch: _Scratch, penalties: Penalties, winners: StripeWinners,
    lanes: Lanes,
) -> None:
    """Three or four paths over stored costs, uint8 ((high - low) * W * lanes)."""
    row, width = way.width * UNIT * len(lanes), way.width
    p1 = penalties.p1_left if way.side == 0 else penalties.p1_right
    down = penalties.down[way.side]
    _start(scratch.line)
    for y in range(way.high - 1 if way.from_below else way.first - 1, way.first - 1, -1):
        at = (y - way.low) * row
        kept = (y - way.first) * row
        into = scratch.below[kept:kept + row] if y < way.last else scratch.below[:0]
        along_columns(costs[at:at + row], p1, down[(y + 1) * width:], scratch.line, into, lanes)
    _start(scratch.line)
    for y in range(way.low, way.first):
        at = (y - way.low) * row
        along_columns(costs[at:at + row], p1, down[y * width:], scratch.line, scratch.below[:0], lanes)
    for y in range(way.first, way.last, ROWS):
        _finish_rows(costs[(y - way.low) * row:], y, min(ROWS, way.last - y), way, scratch, penalties, winners,
                     lanes)


@kernel
def _finish_rows(
    costs: Uint8, y: int, count: int, way: _Way, scratch: _Scratch, penalties: Penalties, winners: StripeWinners,
    lanes: Lanes,
) -> None:
    """The paths along rows y .. y + count - 1, at most ROWS of them, that from above, and the winners."""
    row, width = way.width * UNIT * len(lanes), way.width
    p1 = penalties.p1_left if way.side == 0 else penalties.p1_right
    across = penalties.across[way.side, y * width:]
    along_rows(costs, count, width, p1, across, FROM_LEFT, scratch.sums, lanes)
    along_rows(costs, count, width, p1, across, AVERAGED if way.from_below else ADDED, scratch.sums, lanes)
    for k in range(count):
        steps = p1, penalties.down[way.side, (y + k) * width:]
        sums, kept = scratch.sums[k * row:(k + 1) * row], (y + k - way.first) * row
        more = scratch.below[kept:kept + row] if way.from_below else scratch.below[:0]
        if way.side == 0:
            row_winners = RowWinners(winners.left[y + k], winners.margin[y + k], scratch.lowest)
        else:
            row_winners = RowWinners(winners.right[y + k], winners.margin[0, :0], scratch.lowest)
        take_winners(costs[k * row:], steps, scratch.line, sums, more, winners.masks, row_winners, lanes)
        if way.side == 0 and winners.vertex.size > 0:
            fill_vertices(sums, row_winners.disparity, winners.num_disparities, winners.vertex[y + k], lanes)
