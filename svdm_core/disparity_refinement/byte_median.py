"""The bilateral weighted median of stage 4 (eqs 17-19) of the filled pixels, in bytes.

Disparities, guide and weights have 8 bits, see `similarity` for the exponential of eq 17. Of wide windows every second
row is taken, which takes half the time: the even rows of the image, as neighbours that looked at different rows would
differ. Against `weighted_median` with the same rows one median in a hundred is another, by 1 px mostly.
"""
from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from ..kernels.arrays import Bool, Float32, Int16, Int64, Uint8, Uint16
from ..kernels.compilation import kernel
from ..kernels.instructions import multiply_high
from ..kernels.tasks import share
from ..kernels.vectors import pointer
from ..kernels.wide import (
    UNIT,
    Lanes,
    add_saturated,
    load_wide,
    maximum_wide,
    minimum_wide,
    narrow_wide,
    shift_right,
    splat_wide,
    store_wide,
    sum_wide,
    where_at_most,
    widen,
)
from .label_search import begun, narrowed
from .similarity import similarity, slope_of

ROWS = 4
"""Rows of a task: filled pixels are spread unevenly."""

MOST_DISPARITIES = 256
"""What labels of 8 bits can tell apart."""

STEPS = 64
"""Steps of a disparity in the finished map: 1/64 px."""

_ALL_ROWS = 7
"""px; windows of more than this side are taken by every second row."""

_SPARE = 64


class MedianWindow(NamedTuple):
    """What the window weighs. radius: px; rows: how many are taken, `step` px apart, see `window_rows`.
    spatial: uint16 (rows * lanes), 65536 exp(-|p - q|^2 / sigma_s^2), 0 beside the window. slope: see `similarity`.
    columns: uint8 (W + 2 r + spare), 255 in the image, else 0. most: the largest label."""

    radius: int
    rows: int
    step: int
    spatial: Uint16
    slope: np.uint16
    columns: Uint8
    most: int


def window_rows(w_p: int) -> np.ndarray:
    """Offsets of the rows that are taken of a window of side w_p, px, from the pixel's row or the even one above it."""
    step, r = _row_step(w_p), w_p // 2
    return np.arange(-(r // step) * step, r + 1, step)


def _row_step(w_p: int) -> int:
    return 1 if w_p <= _ALL_ROWS else 2


@functools.lru_cache(maxsize=8)
def median_window(width: int, w_p: int, sigma_s: float, sigma_c: float, num_disparities: int) -> MedianWindow:
    """For images `width` px wide; w_p, sigma_s in px, sigma_c on 0..1."""
    lanes, r = UNIT * len(window_lanes(w_p)), w_p // 2
    columns_of, rows = np.arange(w_p) - r, window_rows(w_p)
    spatial = np.zeros((len(rows), lanes), np.uint16)
    near = np.exp(-(rows[:, None] ** 2 + columns_of**2) / sigma_s**2)
    spatial[:, :w_p] = np.minimum(np.rint(65536 * near), 65535)
    columns = np.zeros(width + 2 * r + _SPARE + lanes, np.uint8)
    columns[r:r + width] = 255
    return MedianWindow(r, len(rows), _row_step(w_p), spatial.reshape(-1), slope_of(sigma_c), columns,
                        num_disparities - 1)


def window_lanes(w_p: int) -> Lanes:
    """Vectors that hold a row of the window."""
    return (0,) * -(-w_p // UNIT)


class MedianMaps(NamedTuple):
    """labels: uint8 (H + 2 r, pitch), filled disparities; guide: uint8 (C, H + 2 r, pitch), grey levels; both with
    margins of r, and room for a vector behind. valid, filled, vertex: (H, W), vertex or (0, 0).
    fixed: uint16 (H, W), the map in 1 / STEPS px, written."""

    labels: Uint8
    guide: Uint8
    valid: Bool
    filled: Int16
    vertex: Float32
    fixed: Uint16


def empty_maps(shape: tuple[int, ...], w_p: int) -> tuple[Uint8, Uint8]:
    """labels and guide of `MedianMaps` for images of `shape`."""
    height, width = shape[:2]
    channels = 1 if len(shape) == 2 else shape[2]
    rows, pitch = height + w_p - 1, width + w_p - 1 + _SPARE + UNIT * len(window_lanes(w_p))
    return np.zeros((rows, pitch), np.uint8), np.zeros((channels, rows, pitch), np.uint8)


@kernel
def fill_margins(counter: Int64, end: int, arenas: Uint8, maps: MedianMaps, side: int, levels: Uint8) -> None:
    """Labels and guide, ROWS rows a task; levels: uint8 (C, H, W)."""
    share(_fill_rows, counter, end, arenas, (maps, side // 2, levels))


@kernel
def _fill_rows(task: int, _arena: Uint8, maps: MedianMaps, r: int, levels: Uint8) -> None:
    height, width = maps.filled.shape
    for y in range(task * ROWS, min(height, (task + 1) * ROWS)):
        for x in range(width):
            maps.labels[y + r, x + r] = np.uint8(maps.filled[y, x])
        for c in range(levels.shape[0]):
            maps.guide[c, y + r, r:r + width] = levels[c, y]


def scratch_size(w_p: int) -> int:
    """Bytes of scratch a task takes."""
    return 2 * (len(window_rows(w_p)) * UNIT * len(window_lanes(w_p)) + _SPARE)


@kernel
def take_medians(
    counter: Int64, end: int, arenas: Uint8, maps: MedianMaps, window: MedianWindow, lanes: Lanes
) -> None:
    """The finished map, ROWS rows a task: valid pixels keep their disparity, the rest get their median."""
    share(_finish_rows, counter, end, arenas, (maps, window, lanes))


@kernel
def _finish_rows(task: int, arena: Uint8, maps: MedianMaps, window: MedianWindow, lanes: Lanes) -> None:
    height, width = maps.filled.shape
    here = _pointers(maps, window, arena, len(lanes) * UNIT)
    for y in range(task * ROWS, min(height, (task + 1) * ROWS)):
        for x in range(width):
            if maps.valid[y, x]:
                part = maps.vertex[y, x] if maps.vertex.size > 0 else np.float32(0)
                maps.fixed[y, x] = np.uint16(np.rint((np.float32(maps.filled[y, x]) + part) * np.float32(STEPS)))
            else:
                maps.fixed[y, x] = STEPS * _median(here, y, x, lanes)


class _Pointers(NamedTuple):
    """What the search of one median needs; no arrays, as numba would count their references at each pixel.

    near: scratch, labels of the window; weights: scratch. labels, guide: of `MedianMaps`, rows `pitch` apart, channels
    of the guide `plane` apart. The rest is that of `MedianWindow`, and the rows of the image.
    """

    near: Any
    weights: Any
    labels: Any
    guide: Any
    pitch: int
    plane: int
    channels: int
    radius: int
    rows: int
    step: int
    spatial: Any
    columns: Any
    slope: np.uint16
    most: int
    height: int


@kernel
def _pointers(maps: MedianMaps, window: MedianWindow, arena: Uint8, step: int) -> _Pointers:
    size = (window.rows * step + _SPARE) // _SPARE * _SPARE
    channels, rows, pitch = maps.guide.shape
    return _Pointers(pointer(arena), pointer(arena[size:]), pointer(maps.labels), pointer(maps.guide), pitch,
                     rows * pitch, channels, window.radius, window.rows, window.step, pointer(window.spatial),
                     pointer(window.columns), window.slope, window.most, maps.filled.shape[0])


@kernel
def _median(at: _Pointers, y: int, x: int, lanes: Lanes) -> int:
    step = UNIT * len(lanes)
    inside, nothing = load_wide(at.columns, x, lanes), splat_wide(np.uint8(0), lanes)
    total = splat_wide(np.uint16(0), lanes)
    top = y // at.step * at.step - at.rows // 2 * at.step
    for k in range(at.rows):
        row = top + k * at.step
        weight = nothing
        if 0 <= row < at.height:
            weight = _colour_weights(at, (y, x), row, k, lanes) & inside
        store_wide(at.weights, k * step, weight)
        store_wide(at.near, k * step, load_wide(at.labels, (row + at.radius) * at.pitch + x, lanes))
        total = total + widen(weight)
    guess: Any = np.int64(at.labels[(y + at.radius) * at.pitch + x + at.radius])
    return _weighted_median(at, guess, sum_wide(total), lanes)


@kernel(inline=True)
def _colour_weights(at: _Pointers, pixel: tuple[int, int], row: int, k: int, lanes: Lanes) -> Any:
    """Weights of the k-th row that is taken of the window around a pixel, image row `row`, 0 .. 255."""
    (y, x), r = pixel, at.radius
    squares = splat_wide(np.uint16(0), lanes)
    for c in range(at.channels):
        own = splat_wide(at.guide[c * at.plane + (y + r) * at.pitch + x + r], lanes)
        other = load_wide(at.guide, c * at.plane + (row + r) * at.pitch + x, lanes)
        difference = widen(maximum_wide(own, other) - minimum_wide(own, other))
        squares = add_saturated(squares, difference * difference)
    spatial = load_wide(at.spatial, k * UNIT * len(lanes), lanes)
    return narrow_wide(shift_right(multiply_high(similarity(squares, at.slope, lanes), spatial), 8))


@kernel(inline=True)
def _weighted_median(at: _Pointers, guess: int, total: np.uint32, lanes: Lanes) -> int:
    """The smallest label with half of the weight at or below it."""
    search = begun(guess, at.most)
    while search.low < search.high:
        search = narrowed(search, bool(2 * np.int64(_weight_up_to(at, search.probe, lanes)) >= total))
    return search.low


@kernel(inline=True)
def _weight_up_to(at: _Pointers, label: int, lanes: Lanes) -> Any:
    step = UNIT * len(lanes)
    limit, below = splat_wide(np.uint8(label), lanes), splat_wide(np.uint16(0), lanes)
    for o in range(0, at.rows * step, step):
        below = below + widen(where_at_most(load_wide(at.near, o, lanes), limit, load_wide(at.weights, o, lanes)))
    return sum_wide(below)
