"""What separates two neighbours: the largest difference of their channels (eq 9), in grey levels of 8 bits.

Differences are rounded, never the images: an image brought to other levels has edges where there are none.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Image, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.stripes import BLOCK, Rows
from ..kernels.tasks import share
from .preparation import PairImages


class Edges(NamedTuple):
    """Of the matched rows of both views, view 1 mirrored: uint8 (2, H + 1, W), 0 at the border.

    across: between pixel (y, x) and (y, x - 1); down: between (y, x) and (y - 1, x), both rows that are matched.
    """

    across: Uint8
    down: Uint8


def empty_edges(rows: Rows) -> Edges:
    """Room for two views with at most those rows."""
    across, down = np.zeros((2, 2, rows.height + 1, rows.width), np.uint8)
    return Edges(across, down)


@kernel
def fill_edges(
    counter: Int64, end: int, arenas: Uint8, edges: Edges, images: PairImages, left: Rows, right: Rows
) -> None:
    """Blocks of BLOCK rows of the left view, then of the right one."""
    share(_fill_task, counter, end, arenas, (edges, images, left, right))


@kernel
def _fill_task(task: int, _arena: Uint8, edges: Edges, images: PairImages, left: Rows, right: Rows) -> None:
    blocks = (left.height + BLOCK - 1) // BLOCK
    if task < blocks:
        _fill_block(task, edges.across[0], edges.down[0], images.left, images.level_gain, left, False)
    else:
        _fill_block(task - blocks, edges.across[1], edges.down[1], images.right, images.level_gain, right, True)


@kernel
def _fill_block(
    block: int, across: Uint8, down: Uint8, image: Image, per_level: np.float32, rows: Rows, mirrored: bool
) -> None:
    near = np.empty((2, rows.width), image.dtype)
    for y in range(block * BLOCK, min((block + 1) * BLOCK, rows.height)):
        row = rows.offset + rows.every * y
        across[y] = 0
        down[y] = 0
        for c in range(image.shape[2]):
            _copy_row(image[row, :, c], mirrored, near[0])
            _copy_row(image[max(row - rows.every, 0), :, c], mirrored, near[1])
            raise_to_differences(near[0, :-1], near[0, 1:], per_level, across[y, 1:])
            if y > 0:
                raise_to_differences(near[0], near[1], per_level, down[y])


@kernel
def _copy_row(row: Image, mirrored: bool, to: Image) -> None:
    if mirrored:
        for x in range(to.size):
            to[x] = row[to.size - 1 - x]
    else:
        for x in range(to.size):
            to[x] = row[x]


@kernel
def raise_to_differences(a: Image, b: Image, per_level: np.float32, edges: Uint8) -> None:
    """edges becomes |a - b| in levels of 8 bits, where that is more; all of one length."""
    if a.itemsize == 1 and per_level == 1:
        for x in range(a.size):
            edges[x] = max(edges[x], np.uint8(max(a[x], b[x]) - min(a[x], b[x])))
        return
    for x in range(a.size):
        difference = np.float32(abs(np.int32(a[x]) - np.int32(b[x]))) * per_level
        edges[x] = max(edges[x], np.uint8(np.rint(min(difference, np.float32(255)))))
