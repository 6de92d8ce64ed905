"""Stage 3, semi-global: what a jump of the disparity costs between two neighbours, less where the image has an edge."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Uint8
from ..kernels.compilation import kernel


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


@kernel
def fill_penalties(penalties: Penalties, view: int, levels: Uint8, row: int, above: int, y: int) -> None:
    """Row y of one view: image row `row` of levels, uint8 (C, H, W), its neighbour above is image row `above`."""
    width = levels.shape[2]
    edges = np.empty((2, width), np.uint8)
    edges[0, 0] = 0
    for x in range(1, width):
        edges[0, x] = _difference(levels[0, row, x], levels[0, row, x - 1])
    for x in range(width):
        edges[1, x] = _difference(levels[0, row, x], levels[0, above, x])
    for c in range(1, levels.shape[0]):
        for x in range(1, width):
            edges[0, x] = max(edges[0, x], _difference(levels[c, row, x], levels[c, row, x - 1]))
        for x in range(width):
            edges[1, x] = max(edges[1, x], _difference(levels[c, row, x], levels[c, above, x]))
    first = y * width
    p1, p2 = (penalties.p1_right, penalties.p2_right) if view == 1 else (penalties.p1_left, penalties.p2_left)
    _look_up(edges[0], view == 1, 1, p1, p2, penalties.p2_edge, penalties.across[view, first:first + width])
    _look_up(edges[1], view == 1, 0, p1, p2, penalties.p2_edge, penalties.down[view, first:first + width])


@kernel
def _difference(a: np.uint8, b: np.uint8) -> np.uint8:
    return np.uint8(max(a, b) - min(a, b))


@kernel
def _look_up(
    edges: Uint8, mirrored: bool, shift: int, p1: np.uint8, p2: np.float32, p2_edge: np.float32, to: Uint8
) -> None:
    """shift: 1 where an edge lies before its pixel, which a mirror puts behind it."""
    width = edges.size
    for x in range(width):
        edge = np.float32(edges[min(width - 1 - x + shift, width - 1) if mirrored else x])
        weight = np.float32(1) + (edge / p2_edge if p2_edge > 0 else np.float32(0))
        to[x] = np.uint8(min(max(np.rint(p2 / weight), np.float32(p1)), np.float32(255)))
