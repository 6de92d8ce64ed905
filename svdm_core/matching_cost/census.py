"""Stage 1, census: which neighbours are darker than a pixel (Zabih and Woodfill 1994), four bits to a byte.

Nibbles, as a table of 16 distances fits into a register: two instructions compare four bits of 32 disparities.
"""
from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels.arrays import Image, Uint8
from ..kernels.compilation import kernel
from ..kernels.vectors import pointer
from ..kernels.wide import UNIT, load_wide, splat_wide, store_wide, where_less

ROWS, COLUMNS = 5, 7
"""The window of the census, px."""

BITS = ROWS * COLUMNS - 1
NIBBLES = -(-BITS // 4)

_LANES = (0, 0)
_STEP = UNIT * len(_LANES)

MARGIN = _STEP
"""Columns behind the last pixel that `fill_census` may write."""


@kernel
def fill_census(grey: Image, first: int, last: int, mirrored: bool, before: int, planes: Uint8) -> None:
    """Rows first .. last - 1 of the census of grey (H, W), uint8 or uint16; borders replicated.

    planes: uint8 (H, NIBBLES, pitch), written from column `before` on, mirrored if wanted, up to a vector beyond the
    last pixel. Bits in reading order of the window, the first one the lowest of nibble 0; a mirrored image has the
    bits of the image itself.
    """
    height, width = grey.shape
    along, across = ROWS // 2, COLUMNS // 2
    near = np.zeros((last - first + 2 * along, width + 2 * across + _STEP), grey.dtype)
    for i in range(near.shape[0]):
        _padded_row(grey[min(max(first + i - along, 0), height - 1)], mirrored, across, near[i])
    places = np.zeros(4 * NIBBLES, np.int64)  # of the neighbours, from the pixel; those behind the last are itself
    bit = 0
    for i in range(ROWS):
        for j in range(COLUMNS):
            if i != along or j != across:
                places[bit] = (i - along) * near.shape[1] + (across - j if mirrored else j - across)
                bit += 1
    pitch = planes.shape[2]
    for y in range(first, last):
        _fill_row(pointer(near), (y - first + along) * near.shape[1] + across, width, pointer(places), pointer(planes),
                  y * NIBBLES * pitch + before, pitch)


@kernel
def _padded_row(row: Image, mirrored: bool, margin: int, padded: Image) -> None:
    width = row.size
    if mirrored:
        for x in range(width):
            padded[margin + x] = row[width - 1 - x]
    else:
        for x in range(width):
            padded[margin + x] = row[x]
    for x in range(margin):
        padded[x] = padded[margin]
        padded[margin + width + x] = padded[margin + width - 1]


@kernel
def _fill_row(near: Any, start: int, width: int, places: Any, planes: Any, to: int, pitch: int) -> None:
    """Pointers: near to the window's rows, whose pixel 0 is at `start`; planes, where row 0 of nibbles begins at `to`.
    """
    for x in range(0, width, _STEP):
        own = load_wide(near, start + x, _LANES)
        for k in range(NIBBLES):
            nibble = splat_wide(np.uint8(0), _LANES)
            for b in range(4):
                other = load_wide(near, start + x + places[4 * k + b], _LANES)
                nibble = nibble | where_less(other, own, splat_wide(np.uint8(1 << b), _LANES))
            store_wide(planes, to + k * pitch + x, nibble)
