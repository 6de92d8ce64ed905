"""Stage 3, semi-global: what a jump of the disparity costs between two neighbours, less where the image has an edge."""
from __future__ import annotations

import functools
from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.stripes import BLOCK, Rows
from ..kernels.tasks import share
from ..matching_cost.edges import Edges


class Penalties(NamedTuple):
    """Of both views, in the unit of the path costs, view 0 the left image and view 1 the mirrored right one.

    p1_left, p1_right: of a step of one disparity. p2_left, p2_right: uint8 (256), of a larger one, by the edge that is
    crossed (`p2_table`). across: uint8 (2, (H + 1) * W), of the steps from pixel k - 1 to k = y W + x; down: the same
    from k - W to k. Those from outside the image have no meaning. The right view's rows are those that are matched.
    """

    p1_left: np.uint8
    p1_right: np.uint8
    p2_left: Uint8
    p2_right: Uint8
    across: Uint8
    down: Uint8


@functools.lru_cache(maxsize=16)
def p2_table(p1: float, p2: float, p2_edge: float) -> Uint8:
    """P2 by the edge, 0 .. 255 levels: p2 / (1 + edge / p2_edge), at least p1 (as Hirschmueller 2008, eq 13), at most
    255; p2 everywhere where p2_edge is 0."""
    weights = 1 + np.arange(256) / p2_edge if p2_edge > 0 else np.ones(256)
    return np.clip(np.rint(p2 / weights), p1, 255).astype(np.uint8)


@kernel
def fill_penalties(
    counter: Int64, end: int, arenas: Uint8, penalties: Penalties, edges: Edges, left: Rows, right: Rows
) -> None:
    """Blocks of BLOCK rows of the left view, then of the right one."""
    share(_fill_block, counter, end, arenas, (penalties, edges, left, right))


@kernel
def _fill_block(task: int, _arena: Uint8, penalties: Penalties, edges: Edges, left: Rows, right: Rows) -> None:
    blocks = (left.height + BLOCK - 1) // BLOCK
    view = 0 if task < blocks else 1
    rows = left if view == 0 else right
    table = penalties.p2_left if view == 0 else penalties.p2_right
    block = task - view * blocks
    for y in range(block * BLOCK, min((block + 1) * BLOCK, rows.height)):
        first, last = y * rows.width, (y + 1) * rows.width
        _look_up(edges.across[view, y], table, penalties.across[view, first:last])
        _look_up(edges.down[view, y], table, penalties.down[view, first:last])


@kernel
def _look_up(edges: Uint8, table: Uint8, to: Uint8) -> None:
    for x in range(to.size):
        to[x] = table[edges[x]]
