"""Stage 4, confidence: how far a disparity can be trusted, from the margin of its winner and that of its neighbours.

The measure is the mean of (valid) x (margin over the best rival) over a small window. Prototypes with up to 54 features
of a pixel and its surroundings told wrong disparities hardly better apart.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Bool, Float32, Image, Int32, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.stripes import BLOCK
from ..kernels.tasks import share, whole_lines

SIDE = 9
"""px, of the window of the mean."""

TEXTURE_ROWS = 7
"""The same for the texture, whose columns are SIDE."""

LEAST_TEXTURE = 0.1
"""Grey levels a pixel; where the mean slope along the row is less, as where the sensor is saturated, nothing was
compared."""

_ACROSS = SIDE // 2
_SOBEL = 8  # what the weights of its differences sum up to


class Evidence(NamedTuple):
    """valid: bool (H, W). margin: uint8 (H, W), of `RowWinners`, or (0, 0): then each valid pixel counts in full.
    grey: uint8 or uint16 (H, W). least: sum of |Sobel| over the window of the texture that is enough."""

    valid: Bool
    margin: Uint8
    grey: Image
    least: int


class Trust(NamedTuple):
    """confidence: float32 (H, W), 0 .. 1. support: uint8 (H, W), the same before the texture is looked at, 0 where not
    valid, or (0, 0) where it is not wanted."""

    confidence: Float32
    support: Uint8


def least_texture(level_gain: float) -> int:
    """Of `Evidence`. level_gain: of `Levels`."""
    return int(np.ceil(LEAST_TEXTURE * _SOBEL * SIDE * TEXTURE_ROWS / level_gain))


def scratch_size(width: int) -> int:
    """Bytes of scratch a task takes."""
    return 5 * whole_lines(4 * (width + 2 * _ACROSS + SIDE))


@kernel
def fill_confidence(counter: Int64, end: int, arenas: Uint8, evidence: Evidence, trust: Trust) -> None:
    """Blocks of BLOCK rows."""
    share(_fill_rows, counter, end, arenas, (evidence, trust))


@kernel
def _fill_rows(task: int, arena: Uint8, evidence: Evidence, trust: Trust) -> None:
    height, width = evidence.valid.shape
    size, pitch = width + 2 * _ACROSS, arena.size // 20
    lines = arena.view(np.int32)
    margins, slopes = lines[:size], lines[pitch:pitch + size]
    of_margins, of_slopes = lines[2 * pitch:2 * pitch + width], lines[3 * pitch:3 * pitch + width]
    spare = lines[4 * pitch:4 * pitch + size]
    margins[:] = 0
    slopes[:] = 0
    first, last = task * BLOCK, min(height, (task + 1) * BLOCK)
    for y in range(first - _ACROSS, first + _ACROSS):
        _add_margins(evidence, y, 1, margins[_ACROSS:])
    for y in range(first - TEXTURE_ROWS // 2, first + TEXTURE_ROWS // 2):
        _add_slopes(evidence.grey, y, 1, slopes)
    for y in range(first, last):
        _add_margins(evidence, y + _ACROSS, 1, margins[_ACROSS:])
        _add_slopes(evidence.grey, y + TEXTURE_ROWS // 2, 1, slopes)
        _sums_of_nine(margins, spare, of_margins)
        _sums_of_nine(slopes, spare, of_slopes)
        _finish_row(evidence, y, of_margins, of_slopes, trust)
        _add_margins(evidence, y - _ACROSS, -1, margins[_ACROSS:])
        _add_slopes(evidence.grey, y - TEXTURE_ROWS // 2, -1, slopes)


@kernel
def _add_margins(evidence: Evidence, y: int, sign: int, sums: Int32) -> None:
    """Those of row y, where there is one."""
    if not 0 <= y < evidence.valid.shape[0]:
        return
    valid, factor = evidence.valid[y], np.int32(sign)
    if evidence.margin.size == 0:
        for x in range(valid.size):
            sums[x] += factor * np.int32(255) * np.int32(valid[x])
        return
    margin = evidence.margin[y]
    for x in range(valid.size):
        sums[x] += factor * np.int32(margin[x]) * np.int32(valid[x])


@kernel
def _add_slopes(grey: Image, y: int, sign: int, sums: Int32) -> None:
    """|Sobel| along row y, borders replicated; sums: (W + 2 _ACROSS), outer columns repeat the outermost."""
    height, width = grey.shape
    y = min(max(y, 0), height - 1)
    above, row, below = grey[max(y - 1, 0)], grey[y], grey[min(y + 1, height - 1)]
    factor = np.int32(sign)
    for x in range(1, width - 1):
        sums[_ACROSS + x] += factor * _slope(above, row, below, x - 1, x + 1)
    if width > 1:
        sums[_ACROSS] += factor * _slope(above, row, below, 0, 1)
        sums[_ACROSS + width - 1] += factor * _slope(above, row, below, width - 2, width - 1)
    sums[:_ACROSS] = sums[_ACROSS]
    sums[_ACROSS + width:] = sums[_ACROSS + width - 1]


@kernel(inline=True)
def _slope(above: Image, row: Image, below: Image, low: int, high: int) -> np.int32:
    """|Sobel| between two columns."""
    return abs(np.int32(above[high]) - np.int32(above[low]) + np.int32(below[high]) - np.int32(below[low])
               + np.int32(2) * (np.int32(row[high]) - np.int32(row[low])))


@kernel
def _sums_of_nine(columns: Int32, pairs: Int32, to: Int32) -> None:
    """to[x] = columns[x] + ... + columns[x + 8]; pairs: scratch as long as columns."""
    size = columns.size
    for x in range(size - 1):
        pairs[x] = columns[x] + columns[x + 1]
    for x in range(to.size):
        to[x] = pairs[x] + pairs[x + 2] + pairs[x + 4] + pairs[x + 6] + columns[x + 8]


@kernel
def _finish_row(evidence: Evidence, y: int, margins: Int32, slopes: Int32, trust: Trust) -> None:
    scale, least = np.float32(1 / (255 * SIDE * SIDE)), np.int32(evidence.least)
    confidence, valid = trust.confidence[y], evidence.valid[y]
    for x in range(margins.size):
        confidence[x] = np.float32(margins[x]) * scale * np.float32(slopes[x] >= least)
    if trust.support.size > 0:
        support = trust.support[y]
        for x in range(margins.size):
            support[x] = np.uint8(np.float32(margins[x]) * np.float32(255) * scale * np.float32(valid[x]))


