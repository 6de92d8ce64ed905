"""Stage 4, plane fit: each disparity moves onto the plane through what is like it around it.

15 pixels are weighted by their own support, by how near their disparity is to the pixel's, and by how alike the two
look; both by Tukey's biweight (1 - x^2)^2. The sums of a pixel are lanes of 16 bits, the plane is float32.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..kernels.arrays import Float32, Int16, Int64, Uint8, Uint16
from ..kernels.compilation import kernel
from ..kernels.instructions import multiply_high
from ..kernels.stripes import BLOCK
from ..kernels.tasks import share, whole_lines
from ..kernels.vectors import pointer
from ..kernels.wide import (
    UNIT,
    as_signed,
    load_wide,
    magnitude,
    maximum_wide,
    minimum_wide,
    shift_right,
    shift_right_signed,
    splat_wide,
    store_wide,
    subtract_signed,
    widen,
)
from .byte_median import STEPS

ROW_STEP, COLUMN_STEP = 6, 4
"""px from one of the 3 rows of samples to the next, and from one of its 5 samples."""

NEAR, NEAR_MORE = 1.0, 0.15
"""Disparities further apart have no weight, px: at the pixel itself, and more for each px of distance |dx| + |dy|."""

ALIKE = 0.1
"""Nor have pixels one of whose channels is further apart, guide on 0..1."""

LEAST_SUPPORT = 5
"""Of 255: what pixels count that nothing supports."""

SPREAD = 1.0
"""px^2, added to the variances of dx and dy: a plane through few pixels stays level."""

_ROWS, _COLUMNS = ROW_STEP, 2 * COLUMN_STEP
"""Margins that samples reach into."""

_LANES = (0,)
_SUMS = 9  # of `_sum_row`
_BIAS = 32768
"""Taken off disparities, so that differences saturate in signed lanes."""


class PlaneMaps(NamedTuple):
    """fixed: uint16 (H, W), disparities in 1 / STEPS px; support: uint8 (H, W); levels: uint8 (C, H, W)."""

    fixed: Uint16
    support: Uint8
    levels: Uint8


class PlaneWeights(NamedTuple):
    """near: uint16 (6), what scales a difference of disparities to 255 where its weight ends: in the pixel's own row,
    0, 1 or 2 columns away, then in another row. nearest: that difference in 1 / STEPS px. alike: as near, of grey
    levels."""

    near: Uint16
    nearest: Uint16
    alike: np.uint16


def plane_weights(level_unit: float) -> PlaneWeights:
    """level_unit: of `Levels`."""
    away = np.array([row + column for row in (0, ROW_STEP) for column in (0, COLUMN_STEP, 2 * COLUMN_STEP)])
    ends = STEPS * (NEAR + NEAR_MORE * away)
    return PlaneWeights(np.floor(255 * 512 / ends).astype(np.uint16), np.floor(ends).astype(np.uint16),
                        np.uint16(min(round(256 * level_unit / ALIKE), 65535)))


def scratch_size(width: int, channels: int) -> int:
    """Bytes of scratch a task takes."""
    pitch = whole_lines(width + 2 * _COLUMNS + UNIT)
    return pitch * ((BLOCK + 2 * _ROWS) * (2 + 2 + channels) + 2 * _SUMS)


@kernel
def fit_planes(
    counter: Int64, end: int, arenas: Uint8, maps: PlaneMaps, weights: PlaneWeights, search: tuple[int, int],
    disparity: Float32,
) -> None:
    """Blocks of BLOCK rows; disparity: float32 (H, W), px, multiples of 1 / STEPS. search: the smallest disparity, and
    how many there are; a plane does not lead out of them."""
    share(_fit_rows, counter, end, arenas, (maps, weights, search, disparity))


class _Padded(NamedTuple):
    """Rows of the maps with margins, `pitch` apart: disparities less _BIAS, int16; support in 1/65536, uint16; channels
    of the guide, uint8, `plane` apart. Pointers, as numba would count references of arrays at each pixel."""

    fixed: Any
    support: Any
    guide: Any
    pitch: int
    plane: int
    channels: int


class _Scales(NamedTuple):
    """Pointers to those of `PlaneWeights`."""

    near: Any
    nearest: Any
    alike: np.uint16


@kernel
def _fit_rows(
    task: int, arena: Uint8, maps: PlaneMaps, weights: PlaneWeights, search: tuple[int, int], disparity: Float32
) -> None:
    height, width = maps.fixed.shape
    channels, rows = maps.levels.shape[0], BLOCK + 2 * _ROWS
    pitch = (width + 2 * _COLUMNS + UNIT + 63) // 64 * 64
    size = rows * pitch
    fixed, rest = arena[:2 * size].view(np.int16), arena[2 * size:]
    support, rest = rest[:2 * size].view(np.uint16), rest[2 * size:]
    guide, rest = rest[:channels * size].reshape(channels, rows, pitch), rest[channels * size:]
    sums = rest[:2 * _SUMS * pitch].view(np.int16).reshape(_SUMS, pitch)
    first, last = task * BLOCK, min(height, (task + 1) * BLOCK)
    for k in range(last - first + 2 * _ROWS):
        row = slice(k * pitch, (k + 1) * pitch)
        _pad_row(maps, first - _ROWS + k, fixed[row], support[row], guide[:, k])
    padded = _Padded(pointer(fixed), pointer(support), pointer(guide), pitch, size, channels)
    scales = _Scales(pointer(weights.near), pointer(weights.nearest), weights.alike)
    for y in range(first, last):
        _sum_row(padded, (y - first) * pitch, width, scales, sums)
        _move_row(maps.fixed[y], sums, search, disparity[y])


@kernel
def _pad_row(maps: PlaneMaps, y: int, fixed: Int16, support: Uint16, guide: Uint8) -> None:
    """Row y, without weight where there is no pixel."""
    height, width = maps.fixed.shape
    support[:] = 0
    if not 0 <= y < height:
        return
    for x in range(width):
        fixed[_COLUMNS + x] = np.int16(np.int32(maps.fixed[y, x]) - _BIAS)
        support[_COLUMNS + x] = np.uint16(256) * max(maps.support[y, x], np.uint8(LEAST_SUPPORT))
    for c in range(maps.levels.shape[0]):
        guide[c, _COLUMNS:_COLUMNS + width] = maps.levels[c, y]


@kernel
def _sum_row(padded: _Padded, start: int, width: int, scales: _Scales, sums: Int16) -> None:
    """Sums over the samples of each pixel of a row: of w times 1, i, j, i i, i j, j j, and of w e / 32 times 1, i, j.

    i -1 .. 1 and j -2 .. 2 count the samples' rows and columns. start: where the row above begins.
    """
    to, pitch = pointer(sums), sums.shape[1]
    below = 2 * ROW_STEP * padded.pitch
    for x in range(0, width, UNIT):
        there = start + x + _COLUMNS
        here = there + ROW_STEP * padded.pitch
        a = _row_of_samples(padded, here, there, scales, 3)
        b = _row_of_samples(padded, here, here, scales, 0)
        c = _row_of_samples(padded, here, there + below, scales, 3)
        store_wide(to, x, a[0] + b[0] + c[0])
        store_wide(to, pitch + x, c[0] - a[0])
        store_wide(to, 2 * pitch + x, a[1] + b[1] + c[1])
        store_wide(to, 3 * pitch + x, a[0] + c[0])
        store_wide(to, 4 * pitch + x, c[1] - a[1])
        store_wide(to, 5 * pitch + x, a[2] + b[2] + c[2])
        store_wide(to, 6 * pitch + x, a[3] + b[3] + c[3])
        store_wide(to, 7 * pitch + x, c[3] - a[3])
        store_wide(to, 8 * pitch + x, a[4] + b[4] + c[4])


@kernel(inline=True)
def _row_of_samples(padded: _Padded, here: int, there: int, scales: _Scales, kind: int) -> Any:
    """Over five samples around `there`: sums of w times 1, j, j j, and of w e / 32 times 1, j. kind: 0 in the pixel's
    own row, 3 in another."""
    w0, e0 = _sample(padded, here, there - 2 * COLUMN_STEP, scales, kind + 2)
    w1, e1 = _sample(padded, here, there - COLUMN_STEP, scales, kind + 1)
    w2, e2 = _sample(padded, here, there, scales, kind)
    w3, e3 = _sample(padded, here, there + COLUMN_STEP, scales, kind + 1)
    w4, e4 = _sample(padded, here, there + 2 * COLUMN_STEP, scales, kind + 2)
    outer, inner, outwards, inwards = w0 + w4, w1 + w3, w4 - w0, w3 - w1
    away = e4 - e0
    squares = outer + outer
    return (outer + inner + w2, outwards + outwards + inwards, squares + squares + inner,
            e0 + e1 + e2 + e3 + e4, away + away + (e3 - e1))


@kernel(inline=True)
def _sample(padded: _Padded, here: int, there: int, scales: _Scales, kind: int) -> Any:
    """(w, w e / 32) of one sample of UNIT pixels: w 0 .. 511, e in 1 / STEPS px."""
    e = subtract_signed(load_wide(padded.fixed, there, _LANES), load_wide(padded.fixed, here, _LANES))
    apart = minimum_wide(magnitude(e), splat_wide(scales.nearest[kind], _LANES))
    apart = apart * splat_wide(np.uint16(128), _LANES)
    weight = _biweight(multiply_high(apart, splat_wide(scales.near[kind], _LANES)))
    unlike = minimum_wide(_unlike(padded, here, there, scales.alike), splat_wide(np.uint16(255), _LANES))
    weight = multiply_high(weight, _biweight(unlike))
    weight = as_signed(shift_right(multiply_high(weight, load_wide(padded.support, there, _LANES)), 7))
    return weight, shift_right_signed(weight * e, 5)


@kernel(inline=True)
def _unlike(padded: _Padded, here: int, there: int, alike: np.uint16) -> Any:
    """The largest difference of the channels, 255 where the weight ends."""
    most = _apart(padded.guide, here, there)
    if padded.channels == 3:  # a loop would be unrolled to more
        most = maximum_wide(most, _apart(padded.guide, padded.plane + here, padded.plane + there))
        most = maximum_wide(most, _apart(padded.guide, 2 * padded.plane + here, 2 * padded.plane + there))
    return multiply_high(widen(most) * splat_wide(np.uint16(256), _LANES), splat_wide(alike, _LANES))


@kernel(inline=True)
def _apart(guide: Any, here: int, there: int) -> Any:
    own, other = load_wide(guide, here, _LANES), load_wide(guide, there, _LANES)
    return maximum_wide(own, other) - minimum_wide(own, other)


@kernel(inline=True)
def _biweight(x: Any) -> Any:
    """(1 - (x / 255)^2)^2 in 1/65536; x: uint16, at most 255."""
    left = splat_wide(np.uint16(255 * 255), _LANES) - x * x
    return multiply_high(left, left)


@kernel
def _move_row(fixed: Uint16, sums: Int16, search: tuple[int, int], to: Float32) -> None:
    """Each pixel of a row by the height of the plane there: the weighted least squares fit of e = a + b dx + c dy."""
    one, start, most = np.float32(1), np.float32(search[0]), np.float32(STEPS * (search[1] - 1))
    spread_i, spread_j = np.float32(SPREAD / ROW_STEP**2), np.float32(SPREAD / COLUMN_STEP**2)
    for x in range(to.size):
        part = one / max(np.float32(sums[0, x]), one)
        i, j, e = sums[1, x] * part, sums[2, x] * part, sums[6, x] * part
        var_i = sums[3, x] * part - i * i + spread_i
        var_j = sums[5, x] * part - j * j + spread_j
        both = sums[4, x] * part - i * j
        with_i, with_j = sums[7, x] * part - i * e, sums[8, x] * part - j * e
        slopes = (with_j * var_i - with_i * both) * j + (with_i * var_j - with_j * both) * i
        moved = np.float32(32) * (e - slopes / (var_i * var_j - both * both))
        height = min(max(np.rint(np.float32(fixed[x]) + moved), np.float32(0)), most)
        to[x] = height * np.float32(1 / STEPS) + start
