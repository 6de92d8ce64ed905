"""Stage 3, semi-global: what a jump of the disparity costs between two neighbours, less where the image has an edge."""
from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from ..kernels.arrays import Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.stripes import BLOCK, Rows
from ..kernels.tasks import take


class Penalties(NamedTuple):
    """Of both views, in the unit of the path costs, view 0 the left image and view 1 the mirrored right one.

    p1_left, p1_right: of a step of one disparity. p2_left, p2_right: the most that a larger one costs; it is
    p2 / (1 + edge / p2_edge), at least P1 (as Hirschmueller 2008, eq 13), edge the largest channel difference in
    grey levels; p2_edge 0: p2 everywhere.
    across: uint8 (2, (H + 1) * W), of the steps from pixel k - 1 to k = y W + x; down: the same from k - W to k. Those
    from outside the image have no meaning. The right view's rows are those that are matched.
    """

    p1_left: np.uint8
    p1_right: np.uint8
    p2_left: np.float32
    p2_right: np.float32
    p2_edge: np.float32
    across: Uint8
    down: Uint8


@kernel(parallel=True)
def fill_penalty_blocks(
    counter: Int64, end: int, arenas: Uint8, penalties: Penalties, levels: Uint8, left: Rows, right: Rows
) -> None:
    """Blocks of BLOCK rows of the left view, then of the right one; levels: uint8 (2, C, H, W), not mirrored."""
    for _ in numba.prange(arenas.shape[0]):
        task = take(counter)
        while task < end:
            _fill_block(task, penalties, levels, left, right)
            task = take(counter)


@kernel
def _fill_block(task: int, penalties: Penalties, levels: Uint8, left: Rows, right: Rows) -> None:
    blocks = (left.height + BLOCK - 1) // BLOCK
    view = 0 if task < blocks else 1
    rows = left if view == 0 else right
    first = (task - view * blocks) * BLOCK
    for y in range(first, min(first + BLOCK, rows.height)):
        row = rows.offset + rows.every * y
        _fill_row(penalties, view, levels[view], row, max(row - rows.every, 0), y)


@kernel
def _fill_row(penalties: Penalties, view: int, levels: Uint8, row: int, above: int, y: int) -> None:
    """Row y of a view: image row `row` of levels, uint8 (C, H, W), whose neighbour above is image row `above`."""
    width, mirrored = levels.shape[2], view == 1
    edges, near = np.zeros((2, width), np.uint8), np.zeros((2, width), np.uint8)
    for c in range(levels.shape[0]):
        _copy_row(levels[c, row], mirrored, near[0])
        _copy_row(levels[c, above], mirrored, near[1])
        _raise_to_difference(near[0, 1:], near[0, :-1], edges[0, 1:])
        _raise_to_difference(near[0], near[1], edges[1])
    p1, p2 = (penalties.p1_left, penalties.p2_left) if view == 0 else (penalties.p1_right, penalties.p2_right)
    first, last = y * width, (y + 1) * width
    _look_up(edges[0], p1, p2, penalties.p2_edge, penalties.across[view, first:last])
    _look_up(edges[1], p1, p2, penalties.p2_edge, penalties.down[view, first:last])


@kernel
def _copy_row(row: Uint8, mirrored: bool, to: Uint8) -> None:
    if mirrored:
        for x in range(to.size):
            to[x] = row[to.size - 1 - x]
    else:
        for x in range(to.size):
            to[x] = row[x]


@kernel
def _raise_to_difference(a: Uint8, b: Uint8, edges: Uint8) -> None:
    for x in range(edges.size):
        edges[x] = max(edges[x], np.uint8(max(a[x], b[x]) - min(a[x], b[x])))


@kernel
def _look_up(edges: Uint8, p1: np.uint8, p2: np.float32, p2_edge: np.float32, to: Uint8) -> None:
    slope = np.float32(1) / p2_edge if p2_edge > 0 else np.float32(0)
    least, most = np.float32(p1), np.float32(255)
    for x in range(to.size):
        to[x] = np.uint8(min(max(np.rint(p2 / (np.float32(1) + np.float32(edges[x]) * slope)), least), most))
