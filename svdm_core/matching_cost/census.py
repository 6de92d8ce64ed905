"""Stage 1, census: which neighbours are darker than a pixel (Zabih and Woodfill 1994), four bits to a byte.

Nibbles, as a table of 16 distances fits into a register: two instructions compare four bits of 32 disparities.
"""
from __future__ import annotations

import numpy as np

from ..kernels.arrays import Image, Uint8
from ..kernels.compilation import kernel

ROWS, COLUMNS = 5, 7
"""The window of the census, px."""

BITS = ROWS * COLUMNS - 1
NIBBLES = -(-BITS // 4)


@kernel
def fill_census(grey: Image, first: int, last: int, mirrored: bool, before: int, planes: Uint8) -> None:
    """Rows first .. last - 1 of the census of grey (H, W), uint8 or uint16; borders replicated.

    planes: uint8 (H, NIBBLES, pitch), written from column `before` on, mirrored if wanted. Bits in reading order of
    the window, the first one the lowest of nibble 0; a mirrored image has the bits of the image itself.
    """
    height, width = grey.shape
    along, across = ROWS // 2, COLUMNS // 2
    near = np.empty((ROWS, width + 2 * across), grey.dtype)
    for y in range(first, last):
        for i in range(ROWS):
            _padded_row(grey[min(max(y + i - along, 0), height - 1)], mirrored, across, near[i])
        own = near[along, across:across + width]
        bit = 0
        for i in range(ROWS):
            for j in range(COLUMNS):
                if i != along or j != across:
                    start = COLUMNS - 1 - j if mirrored else j
                    to = planes[y, bit // 4, before:before + width]
                    if bit % 4 == 0:
                        to[:] = 0
                    _add_bit(near[i, start:start + width], own, np.uint8(1 << bit % 4), to)
                    bit += 1


@kernel
def _padded_row(row: Image, mirrored: bool, margin: int, padded: Image) -> None:
    width = row.size
    for x in range(width):
        padded[margin + x] = row[width - 1 - x] if mirrored else row[x]
    for x in range(margin):
        padded[x] = padded[margin]
        padded[margin + width + x] = padded[margin + width - 1]


@kernel
def _add_bit(neighbour: Image, own: Image, bit: np.uint8, nibbles: Uint8) -> None:
    for x in range(own.size):
        nibbles[x] |= bit if neighbour[x] < own[x] else np.uint8(0)
