"""Where a pixel's own label is its weighted median for certain: found in 16 bits, with a bound of what they may be off.

Grey levels are whole, the exponential of eq 17 is (1 - x / 16 + x^2 / 512)^16, squared four times; sums of a window's
row have 16 bits. What the bound leaves open, one pixel in a hundred, is left to the whole weights of `weighted_median`.
"""
from __future__ import annotations

import functools
import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import DTypeLike, NDArray

from ..kernels.arrays import Bool, Float32, Int16, Int32, Int64, Uint8, Uint16
from ..kernels.compilation import kernel
from ..kernels.instructions import multiply_high
from ..kernels.tasks import do_tasks, share
from ..kernels.vectors import pointer
from ..kernels.wide import (
    UNIT,
    Lanes,
    add_saturated,
    load_wide,
    minimum_wide,
    shift_right,
    splat_wide,
    store_wide,
    where_equal_wide,
    where_less,
)

_LANES: Lanes = (0, 0)
_ACROSS = UNIT * len(_LANES)

# Steps of an exponent x: x = 16 is the largest of 16 bits.
_STEPS = 4096

# Steepest that exp(-u^2) falls: what an error of u does to a weight at most.
_STEEPEST = 0.858

# Steps that an exponent may be too small and too large: two of its parts are rounded, the product is cut off.
_CUT_OFF, _ROUNDED = 2, 1

# Bytes of a task: sums of 16 and of 32 bits.
_SCRATCH = 3 * (2 + 4) * _ACROSS


def settled_pixels(labels: Int32, guide: Float32, window: int, sigma_s: float, sigma_c: float, error: float) -> Bool:
    """bool (H, W): pixels whose label is certain to be the median that `weighted_median` finds for these arguments.

    labels: int32 (H, W), 0 .. 32767. guide: float32 (C, H, W), on 0..1. error: what the weights there may be off.
    """
    (height, width), channels = labels.shape, guide.shape[0]
    weights = _weights(channels, window, sigma_s, sigma_c)
    levels = np.rint(guide * np.float32(weights.levels))
    rounding = float(np.abs(guide - levels * np.float32(1 / weights.levels)).max())
    error += weights.error + _STEEPEST * 2 * rounding * math.sqrt(channels) / sigma_c
    margin = math.ceil(window**2 * min(error, 2.0) * float(weights.unit))
    maps = _Maps(_beside(labels, window, np.int16), _beside(levels, window, np.uint16), _columns(width, window))
    settled = np.empty((height, width), np.bool_)
    do_tasks(_settle, height, maps, weights, margin, settled, _LANES, scratch=_SCRATCH)
    return settled


class _Maps(NamedTuple):
    """labels: int16 (H, pitch), guide: uint16 (C, H, pitch), with margins beside them. columns: uint16 (pitch), 65535
    in the margins, else 0."""

    labels: Int16
    guide: Uint16
    columns: Uint16


class _Weights(NamedTuple):
    """side: of the window, px. exponents: uint16 (side * side), |p - q|^2 / sigma_s^2 in steps. levels: of the guide.
    limit, factor, slope: squares of differences of levels, up to limit, times factor times slope / 65536 are steps.
    unit: weight 1. error: what a weight may be off, for weight 1."""

    side: int
    exponents: Uint16
    levels: int
    limit: np.uint16
    factor: np.uint16
    slope: np.uint16
    unit: np.uint16
    error: float


@functools.lru_cache(maxsize=8)
def _weights(channels: int, window: int, sigma_s: float, sigma_c: float) -> _Weights:
    offsets = np.arange(window) - window // 2
    exponents = np.minimum(np.rint(_STEPS * (offsets[:, None] ** 2 + offsets**2) / sigma_s**2), 65535)
    levels = _levels(channels, sigma_c)
    steps = _STEPS / (levels * sigma_c) ** 2  # of a difference of one level
    doublings = min(max(0, math.ceil(math.log2(steps))), 15)
    limit, slope = 65535 >> doublings, min(round(65536 * steps / 2**doublings), 65535)
    unit = 1 << int(math.log2(65535 / window))
    cut = limit * 2**doublings * slope >> 16 if channels * levels**2 > limit else 65535
    return _Weights(window, exponents.astype(np.uint16).reshape(-1), levels, np.uint16(limit),
                    np.uint16(1 << doublings), np.uint16(slope), np.uint16(unit), _largest_error(unit, cut))


def _levels(channels: int, sigma_c: float) -> int:
    """255, so that images of 8 bits are exact; so many that squares do not overflow where their sums still count."""
    fits = channels * 255**2 < 65536 or 65535 / (255 * sigma_c) ** 2 > 8
    return 255 if fits else math.isqrt(65535 // channels)


def _largest_error(unit: int, cut: int) -> float:
    """Most that a weight is off, of 1; cut: the steps from which on squares are cut off."""
    steps = np.arange(65536)
    share = 65535 - steps + (steps * steps >> 17)
    for _ in range(4):
        share = share * share >> 16
    weights = (share * unit >> 16) / unit
    above = np.exp(-np.maximum(steps - _ROUNDED, 0) / _STEPS) - weights
    below = weights - np.exp(-(steps + _CUT_OFF) / _STEPS)
    return float(max(above.max(), below.max(), weights[cut]))


def _beside(planes: NDArray[Any], window: int, dtype: DTypeLike) -> NDArray[Any]:
    """(..., H, W) with margins at both sides, at the right one more vector, which kernels load."""
    margin = [(0, 0)] * (planes.ndim - 1) + [(window // 2, window // 2 + _ACROSS)]
    return np.pad(planes.astype(dtype), margin)


def _columns(width: int, window: int) -> Uint16:
    return np.pad(np.zeros(width, np.uint16), (window // 2, window // 2 + _ACROSS), constant_values=65535)


@kernel
def _settle(
    counter: Int64, end: int, arenas: Uint8, maps: _Maps, weights: _Weights, margin: int, settled: Bool, lanes: Lanes
) -> None:
    share(_settle_row, counter, end, arenas, (maps, weights, margin, settled, lanes))


@kernel
def _settle_row(
    y: int, arena: Uint8, maps: _Maps, weights: _Weights, margin: int, settled: Bool, lanes: Lanes
) -> None:
    """Weights below the own label < half of the total <= weights up to it, both by more than the margin."""
    across, (height, width), r = UNIT * len(lanes), settled.shape, weights.side // 2
    here = _pointers(maps, weights, arena)
    of_row, of_window = arena.view(np.uint16)[:3 * across], arena[6 * across:].view(np.int32)[:3 * across]
    for x in range(0, width, across):
        of_window[:] = 0
        for row in range(max(0, y - r), min(height, y + r + 1)):
            _add_row(here, (y, x), row, lanes)
            of_window += of_row
        for k in range(min(across, width - x)):
            total, below, equal = of_window[k], of_window[across + k], of_window[2 * across + k]
            settled[y, x + k] = total - 2 * below > margin and 2 * (below + equal) - total > margin


class _Pointers(NamedTuple):
    """What `_add_row` needs of `_Maps` and `_Weights`: no arrays, as numba would count their references at each call.

    sums: uint16 (3 * lanes), written. pitch, plane: from row to row, from channel to channel."""

    sums: Any
    labels: Any
    guide: Any
    columns: Any
    exponents: Any
    pitch: int
    plane: int
    channels: int
    side: int
    limit: np.uint16
    factor: np.uint16
    slope: np.uint16
    unit: np.uint16


@kernel
def _pointers(maps: _Maps, weights: _Weights, arena: Uint8) -> _Pointers:
    channels, rows, pitch = maps.guide.shape
    return _Pointers(pointer(arena.view(np.uint16)), pointer(maps.labels), pointer(maps.guide), pointer(maps.columns),
                     pointer(weights.exponents), pitch, rows * pitch, channels, weights.side, weights.limit,
                     weights.factor, weights.slope, weights.unit)


@kernel
def _add_row(at: _Pointers, pixel: tuple[int, int], row: int, lanes: Lanes) -> None:
    """sums: the weights of a row of the windows of pixels (y, x) and right of it: all, below their labels, equal."""
    y, x = pixel
    r, across = at.side // 2, UNIT * len(lanes)
    own = load_wide(at.labels, y * at.pitch + x + r, lanes)
    total = splat_wide(np.uint16(0), lanes)
    below, equal = total, total
    for j in range(at.side):
        there = row * at.pitch + x + j
        steps = add_saturated(_colour_steps(at, y * at.pitch + x + r, there, lanes),
                              splat_wide(at.exponents[(row - y + r) * at.side + j], lanes))
        weight = _exponential(add_saturated(steps, load_wide(at.columns, x + j, lanes)), at.unit, lanes)
        other = load_wide(at.labels, there, lanes)
        total = total + weight
        below = below + where_less(other, own, weight)
        equal = equal + where_equal_wide(other, own, weight)
    store_wide(at.sums, 0, total)
    store_wide(at.sums, across, below)
    store_wide(at.sums, 2 * across, equal)


@kernel(inline=True)
def _colour_steps(at: _Pointers, here: int, there: int, lanes: Lanes) -> Any:
    """The exponent of colours, in steps; about 65535 where it does not fit."""
    squares = splat_wide(np.uint16(0), lanes)
    for c in range(at.channels):
        difference = load_wide(at.guide, c * at.plane + there, lanes) - load_wide(at.guide, c * at.plane + here, lanes)
        squares = add_saturated(squares, difference * difference)
    squares = minimum_wide(squares, splat_wide(at.limit, lanes)) * splat_wide(at.factor, lanes)
    return multiply_high(squares, splat_wide(at.slope, lanes))


@kernel(inline=True)
def _exponential(steps: Uint16, unit: np.uint16, lanes: Lanes) -> Any:
    """unit * exp(-steps / _STEPS), see `_largest_error`."""
    share = splat_wide(np.uint16(65535), lanes) - steps + shift_right(multiply_high(steps, steps), 1)
    for _ in range(4):
        share = multiply_high(share, share)
    return multiply_high(share, splat_wide(unit, lanes))
