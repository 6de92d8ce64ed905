"""Stage 4, plane fit: each disparity moves onto the plane through what is like it around it.

25 pixels, STEP apart, are weighted by their own support, by how near their disparity is to the pixel's, and by how
alike the two look; both by Tukey's biweight (1 - x^2)^2. The sums of a pixel are lanes of 16 bits, the plane is float32.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..kernels.arrays import Float32, Int64, Uint8, Uint16
from ..kernels.compilation import kernel
from ..kernels.instructions import multiply_high
from ..kernels.stripes import BLOCK
from ..kernels.tasks import share, whole_lines
from ..kernels.vectors import pointer
from ..kernels.wide import (
    UNIT,
    load_wide,
    maximum_wide,
    minimum_wide,
    shift_right,
    splat_wide,
    store_wide,
    subtract_saturated,
    where_less,
    widen,
)
from .byte_median import STEPS

SIDE, STEP = 5, 3
"""Samples along an axis, and px from one to the next."""

NEAR, NEAR_MORE = 1.0, 0.15
"""Disparities further apart have no weight, px: at the pixel itself, and more for each px of distance |dx| + |dy|."""

ALIKE = 0.1
"""Nor have pixels one of whose channels is further apart, guide on 0..1."""

LEAST_SUPPORT = 5
"""Of 255: what pixels count that nothing supports."""

SPREAD = 1.0
"""px^2, added to the variances of dx and dy: a plane through few pixels stays level."""

_REACH = SIDE // 2 * STEP
_LANES = (0,)
_LINES = 9  # of `_Lines`


class PlaneMaps(NamedTuple):
    """fixed: uint16 (H, W), disparities in 1 / STEPS px; support: uint8 (H, W); levels: uint8 (C, H, W)."""

    fixed: Uint16
    support: Uint8
    levels: Uint8


class PlaneWeights(NamedTuple):
    """near: uint16 (SIDE), what scales a difference of disparities to 255 where its weight ends, by |i| + |j|; nearest:
    there, the difference in 1 / STEPS px. alike: the same for 256 grey levels."""

    near: Uint16
    nearest: Uint16
    alike: np.uint16


def plane_weights(level_unit: float) -> PlaneWeights:
    """level_unit: of `Levels`."""
    ends = STEPS * (NEAR + NEAR_MORE * STEP * np.arange(SIDE))
    return PlaneWeights(np.rint(255 * 512 / ends).astype(np.uint16), np.rint(ends).astype(np.uint16),
                        np.uint16(min(round(256 * level_unit / ALIKE), 65535)))


def scratch_size(width: int, channels: int) -> int:
    """Bytes of scratch a task takes."""
    rows, pitch = BLOCK + 2 * _REACH, _pitch(width)
    return rows * pitch * (2 + 1 + channels) + _LINES * 2 * pitch


def _pitch(width: int) -> int:
    return whole_lines(width + 2 * _REACH + UNIT)


@kernel
def fit_planes(
    counter: Int64, end: int, arenas: Uint8, maps: PlaneMaps, weights: PlaneWeights, search: tuple[int, int],
    disparity: Float32,
) -> None:
    """Blocks of BLOCK rows; disparity: float32 (H, W), px, multiples of 1 / STEPS. search: the smallest disparity, and
    how many there are; a plane does not lead out of them."""
    share(_fit_rows, counter, end, arenas, (maps, weights, search, disparity))


class _Padded(NamedTuple):
    """Rows of the three maps with margins, `pitch` apart; channels of the guide `plane` apart. Pointers."""

    fixed: Any
    support: Any
    guide: Any
    pitch: int
    plane: int
    channels: int


class _Lines(NamedTuple):
    """Sums over the samples of each pixel of a row, int16 (pitch): of w times 1, i, j, i i, i j, j j, and of w e / 32
    times 1, i, j; i, j -2 .. 2."""

    w: Any
    wi: Any
    wj: Any
    wii: Any
    wij: Any
    wjj: Any
    e: Any
    ei: Any
    ej: Any


@kernel
def _fit_rows(
    task: int, arena: Uint8, maps: PlaneMaps, weights: PlaneWeights, search: tuple[int, int], disparity: Float32
) -> None:
    height, width = maps.fixed.shape
    channels = maps.levels.shape[0]
    pitch = (width + 2 * _REACH + UNIT + 63) // 64 * 64
    rows = BLOCK + 2 * _REACH
    size = rows * pitch
    fixed, rest = arena[:2 * size].view(np.uint16), arena[2 * size:]
    support, rest = rest[:size], rest[size:]
    guide, rest = rest[:channels * size], rest[channels * size:]
    lines = rest[:2 * _LINES * pitch].view(np.uint16).reshape(_LINES, pitch)
    first, last = task * BLOCK, min(height, (task + 1) * BLOCK)
    for k in range(last - first + 2 * _REACH):
        y = first - _REACH + k
        _pad_row(maps, y, fixed[k * pitch:(k + 1) * pitch], support[k * pitch:(k + 1) * pitch],
                 guide.reshape(channels, rows, pitch)[:, k])
    padded = _Padded(pointer(fixed), pointer(support), pointer(guide), pitch, size, channels)
    sums = _Lines(pointer(lines[0]), pointer(lines[1]), pointer(lines[2]), pointer(lines[3]), pointer(lines[4]),
                  pointer(lines[5]), pointer(lines[6]), pointer(lines[7]), pointer(lines[8]))
    for y in range(first, last):
        _sum_row(padded, (y - first) * pitch, width, pointer(weights.near), pointer(weights.nearest), weights.alike,
                 sums)
        _move_row(maps.fixed[y], lines.view(np.int16), search, disparity[y])


@kernel
def _pad_row(maps: PlaneMaps, y: int, fixed: Uint16, support: Uint8, guide: Uint8) -> None:
    """Row y, without weight where there is no pixel."""
    height, width = maps.fixed.shape
    support[:] = 0
    if not 0 <= y < height:
        return
    fixed[_REACH:_REACH + width] = maps.fixed[y]
    for x in range(width):
        support[_REACH + x] = max(maps.support[y, x], np.uint8(LEAST_SUPPORT))
    for c in range(maps.levels.shape[0]):
        guide[c, _REACH:_REACH + width] = maps.levels[c, y]


@kernel
def _sum_row(
    padded: _Padded, start: int, width: int, near: Any, nearest: Any, alike: np.uint16, sums: _Lines
) -> None:
    """Sums of the pixels of a row; start: where its first sample row begins."""
    zero = splat_wide(np.uint16(0), _LANES)
    for x in range(0, width, UNIT):
        here = start + x + _REACH * padded.pitch + _REACH
        w, wi, wj, wii, wij, wjj, e, ei, ej = zero, zero, zero, zero, zero, zero, zero, zero, zero
        for row in range(SIDE):
            i = splat_wide(np.uint16(row - SIDE // 2), _LANES)
            w0, w1, w2, e0, e1 = zero, zero, zero, zero, zero
            for column in range(SIDE):
                there = start + x + row * STEP * padded.pitch + column * STEP
                away = abs(row - SIDE // 2) + abs(column - SIDE // 2)
                j = splat_wide(np.uint16(column - SIDE // 2), _LANES)
                weight, moved = _sample(padded, here, there, near[away], nearest[away], alike)
                w0, w1, w2 = w0 + weight, w1 + weight * j, w2 + weight * j * j
                e0, e1 = e0 + moved, e1 + moved * j
            w, wi, wj = w + w0, wi + w0 * i, wj + w1
            wii, wij, wjj = wii + w0 * i * i, wij + w1 * i, wjj + w2
            e, ei, ej = e + e0, ei + e0 * i, ej + e1
        _store_sums(sums, x, (w, wi, wj, wii, wij, wjj), (e, ei, ej))


@kernel(inline=True)
def _store_sums(sums: _Lines, x: int, weights: Any, moves: Any) -> None:
    store_wide(sums.w, x, weights[0])
    store_wide(sums.wi, x, weights[1])
    store_wide(sums.wj, x, weights[2])
    store_wide(sums.wii, x, weights[3])
    store_wide(sums.wij, x, weights[4])
    store_wide(sums.wjj, x, weights[5])
    store_wide(sums.e, x, moves[0])
    store_wide(sums.ei, x, moves[1])
    store_wide(sums.ej, x, moves[2])


@kernel(inline=True)
def _sample(padded: _Padded, here: int, there: int, near: np.uint16, nearest: np.uint16, alike: np.uint16) -> Any:
    """(w, w e / 32) of one sample of UNIT pixels: w 0 .. 511, e in 1 / STEPS px, signed."""
    own, other = load_wide(padded.fixed, here, _LANES), load_wide(padded.fixed, there, _LANES)
    apart = subtract_saturated(own, other) + subtract_saturated(other, own)
    apart = minimum_wide(apart, splat_wide(nearest, _LANES))
    weight = _biweight(multiply_high(apart * splat_wide(np.uint16(128), _LANES), splat_wide(near, _LANES)))
    weight = multiply_high(weight, _biweight(_unlike(padded, here, there, alike)))
    support = widen(load_wide(padded.support, there, _LANES)) * splat_wide(np.uint16(256), _LANES)
    weight = shift_right(multiply_high(weight, support), 7)
    moved = shift_right(weight * apart, 5)
    back = where_less(other, own, moved)
    return weight, moved - back - back


@kernel(inline=True)
def _unlike(padded: _Padded, here: int, there: int, alike: np.uint16) -> Any:
    """The largest difference of the channels, 255 where the weight ends."""
    most = splat_wide(np.uint8(0), _LANES)
    for c in range(padded.channels):
        own = load_wide(padded.guide, c * padded.plane + here, _LANES)
        other = load_wide(padded.guide, c * padded.plane + there, _LANES)
        most = maximum_wide(most, maximum_wide(own, other) - minimum_wide(own, other))
    return multiply_high(widen(most) * splat_wide(np.uint16(256), _LANES), splat_wide(alike, _LANES))


@kernel(inline=True)
def _biweight(x: Any) -> Any:
    """(1 - (x / 255)^2)^2 in 1/65536, 0 from 255 on."""
    x = minimum_wide(x, splat_wide(np.uint16(255), _LANES))
    left = splat_wide(np.uint16(255 * 255), _LANES) - x * x
    return multiply_high(left, left)


@kernel
def _move_row(fixed: Uint16, sums: Any, search: tuple[int, int], to: Float32) -> None:
    """Each pixel of a row by the height of the plane there: the weighted least squares fit of e = a + b dx + c dy."""
    one, spread = np.float32(1), np.float32(SPREAD / STEP**2)
    start, most = np.float32(search[0]), np.float32(STEPS * (search[1] - 1))
    for x in range(to.size):
        share_of = one / max(np.float32(sums[0, x]), one)
        i, j, e = sums[1, x] * share_of, sums[2, x] * share_of, sums[6, x] * share_of
        var_i = sums[3, x] * share_of - i * i + spread
        var_j = sums[5, x] * share_of - j * j + spread
        both = sums[4, x] * share_of - i * j
        with_i, with_j = sums[7, x] * share_of - i * e, sums[8, x] * share_of - j * e
        slopes = (with_j * var_i - with_i * both) * j + (with_i * var_j - with_j * both) * i
        moved = np.float32(32) * (e - slopes / (var_i * var_j - both * both))
        height = min(max(np.rint(np.float32(fixed[x]) + moved), np.float32(0)), most)
        to[x] = height * np.float32(1 / STEPS) + start
