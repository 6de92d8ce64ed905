"""Stage 3, semi-global: what a jump of the disparity costs between two neighbours, less where the image has an edge."""
from __future__ import annotations

from typing import NamedTuple

import numba
import numpy as np

from ..kernels.arrays import Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.stripes import BLOCK, Rows
from ..kernels.tasks import take
from ..matching_cost.edges import Edges


class Penalties(NamedTuple):
    """Of both views, in the unit of the path costs, view 0 the left image and view 1 the mirrored right one.

    p1_left, p1_right: of a step of one disparity. p2_left, p2_right: the most that a larger one costs; it is
    p2 / (1 + edge / p2_edge), at least P1 (as Hirschmueller 2008, eq 13), edge that of `Edges`; p2_edge 0: p2
    everywhere.
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
def fill_penalties(
    counter: Int64, end: int, arenas: Uint8, penalties: Penalties, edges: Edges, left: Rows, right: Rows
) -> None:
    """Blocks of BLOCK rows of the left view, then of the right one."""
    for _ in numba.prange(arenas.shape[0]):
        task = take(counter)
        while task < end:
            _fill_block(task, penalties, edges, left, right)
            task = take(counter)


@kernel
def _fill_block(task: int, penalties: Penalties, edges: Edges, left: Rows, right: Rows) -> None:
    blocks = (left.height + BLOCK - 1) // BLOCK
    view = 0 if task < blocks else 1
    rows = left if view == 0 else right
    p1, p2 = (penalties.p1_left, penalties.p2_left) if view == 0 else (penalties.p1_right, penalties.p2_right)
    block = task - view * blocks
    for y in range(block * BLOCK, min((block + 1) * BLOCK, rows.height)):
        first, last = y * rows.width, (y + 1) * rows.width
        _look_up(edges.across[view, y], p1, p2, penalties.p2_edge, penalties.across[view, first:last])
        _look_up(edges.down[view, y], p1, p2, penalties.p2_edge, penalties.down[view, first:last])


@kernel
def _look_up(edges: Uint8, p1: np.uint8, p2: np.float32, p2_edge: np.float32, to: Uint8) -> None:
    slope = np.float32(1) / p2_edge if p2_edge > 0 else np.float32(0)
    least, most = np.float32(p1), np.float32(255)
    for x in range(to.size):
        to[x] = np.uint8(min(max(np.rint(p2 / (np.float32(1) + np.float32(edges[x]) * slope)), least), most))
