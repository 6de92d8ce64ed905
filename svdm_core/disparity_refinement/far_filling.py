"""Stage 4, filling from afar: what only the left camera sees, in place of the nearest valid pixel on the row (eq 16).

That pixel is a wrong guess where the whole row's beginning has no partner (the left border), and where the two sides of
a gap differ much. There the weighted median (eqs 17-19) of valid pixels of a wide, sparse window decides: 15 x 15
pixels, as far apart as lets the window reach across a border that is as wide as the search range. The samples are the
same ones for all pixels, so that rows that are neighbours are filled alike.
"""
from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from ..kernels.arrays import Bool, Int16, Int32, Int64, Uint8, Uint16
from ..kernels.compilation import kernel
from ..kernels.instructions import multiply_high
from ..kernels.tasks import share
from ..kernels.vectors import pointer
from ..kernels.wide import (
    UNIT,
    add_saturated,
    load_wide,
    maximum_wide,
    minimum_wide,
    shift_right,
    splat_wide,
    store_wide,
    sum_wide,
    where_at_most,
    where_less,
    widen,
)
from .label_search import begun, narrowed
from .similarity import similarity, slope_of

ROWS = 4
"""Rows of a task: gaps are spread unevenly."""

SIDE = 15
"""Samples of the window along an axis; a row of them fits into UNIT lanes."""

REACH = 16
"""The window's columns are 2 / REACH of the search range apart, so that half of it reaches as far as that is wide."""

SIGMA_S, SIGMA_C = 4.0, 0.04
"""Reach of the weights (eq 17): samples, and guide on 0..1."""

DEPTH_STEP = 3
"""px; a gap whose sides are further apart lies behind a depth edge."""

LEAST_WEIGHT = 0.05
"""Sum of weights below which nothing like the pixel is near."""

_LANES = (0,)
_NOTHING = np.uint16(65535)
_MARGIN = SIDE // 2
_ALIKE_ROWS = 2
"""Rows that share their medians, so far away is what they look at."""

_UNKNOWN = np.int16(-2)
_FULL = 4095
"""Weight 1: a column of the window fits into 16 bits."""

_LINE_PIXELS, _LINE_SLOPE, _LINE_SHARE, _LINE_NEAR = 40, 0.3, 0.7, 3.0
"""A border goes on along the line through its first 40 valid pixels, of at most that slope, of which it takes a share;
px from what the window says, at most."""


class FarWindow(NamedTuple):
    """column: image columns to one of the sparse ones; the window takes every second. spatial: uint16 (SIDE * UNIT),
    65535 for weight 1, 0 beside the window. slope: see `similarity`. most: the largest label."""

    column: int
    spatial: Uint16
    slope: np.uint16
    most: int


class FarMaps(NamedTuple):
    """Every column-th pixel of every (2 column)-th row, even and odd ones apart so that the window's are neighbours,
    with margins.

    labels: uint16 (2, rows, pitch), disparities, 65535 where not valid; guide: uint8 (C, 2, rows, pitch).
    """

    labels: Uint16
    guide: Uint8


class Gaps(NamedTuple):
    """A map to be filled. valid: bool (H, W). filled: int16 (H, W), valid pixels and what the row says, changed. runs:
    of `Checked`. levels: uint8 (C, H, W)."""

    valid: Bool
    filled: Int16
    runs: Int32
    levels: Uint8


@functools.lru_cache(maxsize=8)
def far_window(num_disparities: int, level_unit: float) -> FarWindow:
    """level_unit: of `Levels`."""
    offsets = np.arange(SIDE) - _MARGIN
    spatial = np.zeros((SIDE, UNIT), np.uint16)
    spatial[:, :SIDE] = np.rint(65535 * np.exp(-(offsets[:, None] ** 2 + offsets**2) / SIGMA_S**2))
    return FarWindow(-(-num_disparities // REACH), spatial.reshape(-1), slope_of(SIGMA_C / level_unit),
                     num_disparities - 1)


def empty_far_maps(shape: tuple[int, ...], num_disparities: int) -> FarMaps:
    """For images of `shape`."""
    height, width = shape[:2]
    channels = 1 if len(shape) == 2 else shape[2]
    column = -(-num_disparities // REACH)
    rows, pitch = -(-height // (2 * column)), (-(-width // column) + 1) // 2 + _MARGIN + UNIT
    return FarMaps(np.full((2, rows, pitch), _NOTHING, np.uint16), np.zeros((channels, 2, rows, pitch), np.uint8))


def sampled_rows(far: FarMaps) -> int:
    """Tasks of `fill_far_maps`."""
    return int(far.labels.shape[1])


@kernel
def fill_far_maps(counter: Int64, end: int, arenas: Uint8, far: FarMaps, window: FarWindow, gaps: Gaps) -> None:
    """A row a task."""
    share(_sample_row, counter, end, arenas, (far, window, gaps))


@kernel
def _sample_row(task: int, _arena: Uint8, far: FarMaps, window: FarWindow, gaps: Gaps) -> None:
    height, width = gaps.valid.shape
    y = min((2 * task + 1) * window.column, height - 1)
    for k in range((width + window.column - 1) // window.column):
        x = min(k * window.column + window.column // 2, width - 1)
        to = _MARGIN + k // 2
        far.labels[k % 2, task, to] = np.uint16(gaps.filled[y, x]) if gaps.valid[y, x] else _NOTHING
        for c in range(gaps.levels.shape[0]):
            far.guide[c, k % 2, task, to] = gaps.levels[c, y, x]


def scratch_size(width: int) -> int:
    """Bytes of scratch a task takes."""
    return 2 * (2 * SIDE * UNIT + width)


@kernel
def fill_from_afar(counter: Int64, end: int, arenas: Uint8, far: FarMaps, window: FarWindow, gaps: Gaps) -> None:
    """ROWS rows a task."""
    share(_fill_rows, counter, end, arenas, (far, window, gaps))


@kernel
def _fill_rows(task: int, arena: Uint8, far: FarMaps, window: FarWindow, gaps: Gaps) -> None:
    height, width = gaps.valid.shape
    scratch = arena.view(np.int16)
    at, known = _pointers(far, window, gaps, scratch), scratch[2 * SIDE * UNIT:][:width]
    for y in range(task * ROWS, min(height, (task + 1) * ROWS)):
        if y % _ALIKE_ROWS == 0:
            known[:] = _UNKNOWN
        runs, filled = gaps.runs[y], gaps.filled[y]
        for n in range(runs[0]):
            x: Any = runs[1 + 2 * n]
            end: Any = runs[2 + 2 * n]
            if x == 0:
                _fill_border(at, y, end, known, filled)
                _continue_line(gaps.valid[y], end, window.most, filled)
            elif end < width and abs(filled[x - 1] - filled[end]) > DEPTH_STEP:
                _fill_gap(at, y, (x, end), known, filled)


@kernel
def _fill_border(at: _Pointers, y: int, end: int, known: Int16, filled: Int16) -> None:
    for k in range((end + at.column - 1) // at.column):
        first, last = k * at.column, min(end, (k + 1) * at.column)
        median = _median_of(at, y, (first, last), known, filled[first])
        if median >= 0:
            filled[first:last] = median


@kernel
def _fill_gap(at: _Pointers, y: int, run: tuple[int, int], known: Int16, filled: Int16) -> None:
    """What one camera alone sees lies behind: never nearer than the row says."""
    start, end = run
    for k in range(start // at.column, (end + at.column - 1) // at.column):
        first, last = max(start, k * at.column), min(end, (k + 1) * at.column)
        median = _median_of(at, y, (first, last), known, filled[first])
        if 0 <= median < filled[first]:
            filled[first:last] = median


@kernel
def _median_of(at: _Pointers, y: int, run: tuple[int, int], known: Int16, guess: int) -> Any:
    """Of the pixels run[0] .. run[1] - 1 of a sparse column, from the row above where it is known there; -1 where there
    is too little like them."""
    first, last = run
    k = first // at.column
    if known[k] == _UNKNOWN:
        x = min(max(k * at.column + at.column // 2, first), last - 1)
        known[k] = np.int16(_far_median(at, y, x, guess))
    return np.int64(known[k])


@kernel
def _continue_line(valid: Bool, end: int, most: int, filled: Int16) -> None:
    """The border's pixels 0 .. end - 1 on the line through the valid ones behind it, where the window says so about."""
    count, total_x, total_d, total_xx, total_xd = 0, 0.0, 0.0, 0.0, 0.0
    for x in range(end, valid.size):
        if valid[x]:
            d = float(filled[x])
            count, total_x, total_d = count + 1, total_x + x, total_d + d
            total_xx, total_xd = total_xx + x * x, total_xd + x * d
            if count == _LINE_PIXELS:
                break
    if count < _LINE_PIXELS:
        return
    middle, level = total_x / count, total_d / count
    slope = (total_xd / count - middle * level) / (total_xx / count - middle * middle)
    slope = _LINE_SHARE * min(max(slope, -_LINE_SLOPE), _LINE_SLOPE)
    for x in range(end):
        on_line = min(level + slope * (x - middle), float(most))
        if on_line >= 0 and abs(on_line - filled[x]) <= _LINE_NEAR:
            filled[x] = np.int16(np.rint(on_line))


class _Pointers(NamedTuple):
    """What the search of one median needs; no arrays, as numba would count their references at each pixel.

    near, weights: scratch, labels and weights of the window. labels, guide: of `FarMaps`, rows `pitch` apart, phases
    `phase` apart, channels twice that. levels: of the image.
    """

    near: Any
    weights: Any
    labels: Any
    guide: Any
    pitch: int
    phase: int
    levels: Any
    channels: int
    height: int
    width: int
    rows: int
    column: int
    spatial: Any
    slope: np.uint16
    most: int


@kernel
def _pointers(far: FarMaps, window: FarWindow, gaps: Gaps, arena: Int16) -> _Pointers:
    scratch = arena.view(np.uint16)
    channels, height, width = gaps.levels.shape
    _, rows, pitch = far.labels.shape
    return _Pointers(pointer(scratch), pointer(scratch[SIDE * UNIT:]), pointer(far.labels), pointer(far.guide), pitch,
                     rows * pitch, pointer(gaps.levels), channels, height, width, rows, window.column,
                     pointer(window.spatial), window.slope, window.most)


@kernel
def _far_median(at: _Pointers, y: int, x: int, guess: int) -> int:
    """The weighted median of the window around pixel (y, x); -1 where there is too little like it."""
    k, middle = x // at.column, y // (2 * at.column)
    start, total = k % 2 * at.phase + k // 2, splat_wide(np.uint16(0), _LANES)
    for i in range(SIDE):
        row, weight = middle + i - _MARGIN, splat_wide(np.uint16(0), _LANES)
        if 0 <= row < at.rows:
            place = start + row * at.pitch
            labels = load_wide(at.labels, place, _LANES)
            weight = where_less(labels, splat_wide(_NOTHING, _LANES), _weights(at, (y, x), place, i))
            store_wide(at.near, i * UNIT, labels)
        store_wide(at.weights, i * UNIT, weight)
        total = total + weight
    whole: Any = np.int64(sum_wide(total))
    return _weighted_median(at, whole, guess) if whole > LEAST_WEIGHT * _FULL else -1


@kernel(inline=True)
def _weights(at: _Pointers, pixel: tuple[int, int], place: int, i: int) -> Any:
    """Of row i of the window, 0 .. _FULL; place: where it begins in the sparse maps."""
    y, x = pixel
    squares = splat_wide(np.uint16(0), _LANES)
    for c in range(at.channels):
        own = splat_wide(at.levels[(c * at.height + y) * at.width + x], _LANES)
        other = load_wide(at.guide, 2 * c * at.phase + place, _LANES)
        difference = widen(maximum_wide(own, other) - minimum_wide(own, other))
        squares = add_saturated(squares, difference * difference)
    spatial = load_wide(at.spatial, i * UNIT, _LANES)
    return shift_right(multiply_high(similarity(squares, at.slope, _LANES), spatial), 4)


@kernel
def _weighted_median(at: _Pointers, total: int, guess: int) -> int:
    """The smallest label with half of the weight at or below it."""
    search = begun(guess, at.most)
    while search.low < search.high:
        search = narrowed(search, bool(2 * np.int64(_weight_up_to(at, search.probe)) >= total))
    return search.low


@kernel(inline=True)
def _weight_up_to(at: _Pointers, label: int) -> Any:
    limit, below = splat_wide(np.uint16(label), _LANES), splat_wide(np.uint16(0), _LANES)
    for o in range(0, SIDE * UNIT, UNIT):
        below = below + where_at_most(load_wide(at.near, o, _LANES), limit, load_wide(at.weights, o, _LANES))
    return sum_wide(below)
