"""The bilateral weighted median of stage 4 (eqs 17-19).

Weights are rounded to integers (`_weight_scale`), so that their sums are exact in any order: every way
to find the median, and any number of threads, gives the same one.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..kernels.arrays import Bool, Float32, Int32, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.tasks import do_tasks, share
from .separable_median import WEIGHT_ERROR, separable_median
from .settled_pixels import settled_pixels

# Weights below exp(-40) are 0 after rounding; stopping there keeps `_exp_minus` free of denormal numbers.
_LARGEST_EXPONENT = np.float32(40)

# Guide value around the image: so far off that its weight is 0, and no window needs cutting.
_NO_NEIGHBOUR = np.float32(1e6)

# float32 in a vector register; loops of this constant length compile to single instructions.
_LANES = 16

# Pixels searched by one task: enough to spread uneven work, few enough to reuse its buffers.
_CHUNK = 256


def weighted_median(
    labels: Int32,
    guide: Float32,
    wanted: Bool | None,
    window: int,
    sigma_s: float,
    sigma_c: float,
) -> Int32:
    """Replace labels by the weighted median of the window around them, cut off at the image border.

    labels: int32 (H, W), 0 .. 32767, the disparities as integers. guide: float32 (C, H, W), C 1 or 3, on 0..1.
    wanted: bool (H, W), the pixels to replace, None for all. window: w_p, odd, px. sigma_s in px,
    sigma_c on 0..1. The weight of q for p is exp(-|p - q|^2 / sigma_s^2) exp(-|g(p) - g(q)|^2 / sigma_c^2),
    the median the smallest label at which the weights summed from 0 reach half of their total.
    """
    near = _surrounded(labels[None], np.int32(1), window // 2, np.int32(0))[0]
    there = _surrounded(guide, np.float32(1 / sigma_c), window // 2, _NO_NEIGHBOUR)
    scale = _weight_scale(window)
    around = _Window(window, _spatial_exponents(window, sigma_s), scale)
    result = labels.copy()
    if wanted is None:
        wanted = ~settled_pixels(labels, guide, window, sigma_s, sigma_c, WEIGHT_ERROR / float(scale))
    pixels = np.flatnonzero(wanted)
    do_tasks(_search, -(-pixels.size // _CHUNK), near, there, pixels, around, result)
    return result


def weighted_median_of_disparity(
    labels: Int32, wanted: Bool | None, window: int, sigma_s: float, sigma_c: float, num_disparities: int
) -> Int32:
    """`weighted_median` guided by labels / num_disparities: the same result, sooner where all pixels are wanted."""
    guide = (labels / np.float32(num_disparities)).astype(np.float32)[None]
    if wanted is not None:
        return weighted_median(labels, guide, wanted, window, sigma_s, sigma_c)
    medians, certain = separable_median(labels, window, sigma_s, sigma_c * num_disparities,
                                         float(_weight_scale(window)))
    left_over = weighted_median(labels, guide, ~certain, window, sigma_s, sigma_c)
    return np.where(certain, medians, left_over)


def _surrounded(planes: NDArray[Any], factor: Any, margin: int, outside: Any) -> NDArray[Any]:
    """planes (C, H, W) times factor, with margins of `outside`: on the right one more vector, which kernels load."""
    channels, height, width = planes.shape
    result = np.full((channels, height + 2 * margin, width + 2 * margin + _LANES), outside, planes.dtype)
    np.multiply(planes, factor, out=result[:, margin:margin + height, margin:margin + width])
    return result


def _spatial_exponents(window: int, sigma_s: float) -> Float32:
    """|p - q|^2 / sigma_s^2 over the window, float32 (window, columns): columns filled up to whole vectors."""
    offsets = np.arange(window) - window // 2
    exponents = np.full((window, -(-window // _LANES) * _LANES), _LARGEST_EXPONENT, np.float32)
    exponents[:, :window] = (offsets[:, None] ** 2 + offsets**2) / sigma_s**2
    return exponents


def _weight_scale(window: int) -> np.float32:
    """The power of two that stands for weight 1: the largest with which a whole window stays below 2^30."""
    return np.float32(2.0 ** (29 - (window**2 - 1).bit_length()))


@kernel
def _exp_minus(x: np.float32) -> np.float32:
    """exp(-x) for 0 <= x, to 4e-6 absolutely: its cubic at x / 64, squared six times; no branch, no table."""
    y = min(x, _LARGEST_EXPONENT) * np.float32(1 / 64)
    e = np.float32(1) - y * (np.float32(1) - y * (np.float32(1 / 2) - y * np.float32(1 / 6)))
    e *= e
    e *= e
    e *= e
    e *= e
    e *= e
    return e * e


class _Window(NamedTuple):
    """The window of the median: its side, px; the exponents of its weights; the weight 1."""

    side: int
    exponents: Float32
    scale: np.float32


@kernel
def _search(
    counter: Int64, end: int, arenas: Uint8, labels: Int32, guide: Float32, pixels: NDArray[np.int64],
    window: _Window, result: Int32,
) -> None:
    share(_search_chunk, counter, end, arenas, (labels, guide, pixels, window, result))


@kernel
def _search_chunk(
    chunk: int, _arena: Uint8, labels: Int32, guide: Float32, pixels: NDArray[np.int64], window: _Window, result: Int32
) -> None:
    """result[p] = weighted median at each flat pixel index p of `pixels`; labels and guide have their margins."""
    width, r, exponents = result.shape[1], window.side // 2, window.exponents
    near = np.empty(exponents.size, np.int32)
    weights = np.empty(exponents.size, np.int32)
    for p in pixels[chunk * _CHUNK:(chunk + 1) * _CHUNK]:
        y, x = p // width, p % width
        if guide.shape[0] == 1:
            _window_weights_grey(guide[0], y, x, r, exponents, window.scale, weights)
        else:
            _window_weights_colour(guide, y, x, r, exponents, window.scale, weights)
        _window_labels(labels, y, x, exponents, near)
        result[y, x] = _median(near, weights, labels[y + r, x + r])


@kernel
def _window_labels(labels: Int32, y: int, x: int, exponents: Float32, near: Int32) -> None:
    rows, columns = exponents.shape
    for i in range(rows):
        to, source = near[i * columns:(i + 1) * columns], labels[y + i, x:x + columns]
        for k in range(columns):
            to[k] = source[k]


@kernel
def _window_weights_grey(
    guide: Float32, y: int, x: int, r: int, exponents: Float32, scale: np.float32, weights: Int32,
) -> None:
    """Integer weights of the window around pixel (y, x), row after row; guide (H, W) with margins."""
    rows, columns = exponents.shape
    a = guide[y + r, x + r]
    for i in range(rows):
        b, exponent, to = guide[y + i, x:x + columns], exponents[i], weights[i * columns:(i + 1) * columns]
        for k in range(columns):
            u = a - b[k]
            to[k] = np.int32(_exp_minus(exponent[k] + u * u) * scale + np.float32(0.5))


@kernel
def _window_weights_colour(
    guide: Float32, y: int, x: int, r: int, exponents: Float32, scale: np.float32, weights: Int32,
) -> None:
    """The same for three channels; guide (3, H, W)."""
    g0, g1, g2 = guide[0], guide[1], guide[2]
    rows, columns = exponents.shape
    a0, a1, a2 = g0[y + r, x + r], g1[y + r, x + r], g2[y + r, x + r]
    for i in range(rows):
        b0, b1, b2 = g0[y + i, x:x + columns], g1[y + i, x:x + columns], g2[y + i, x:x + columns]
        exponent, to = exponents[i], weights[i * columns:(i + 1) * columns]
        for k in range(columns):
            u, v, w = a0 - b0[k], a1 - b1[k], a2 - b2[k]
            to[k] = np.int32(_exp_minus(exponent[k] + (u * u + v * v + w * w)) * scale + np.float32(0.5))


@kernel
def _weight_up_to(near: Int32, weights: Int32, label: int) -> np.int32:
    total = np.int32(0)
    for i in range(near.size):
        total += np.int32(near[i] <= label) * weights[i]
    return total


@kernel
def _median(near: Int32, weights: Int32, guess: int) -> np.int32:
    """Smallest label with half of the weight at or below it; gallops from `guess`, then bisects."""
    highest = np.int32(0)
    lowest = near[0]
    total = np.int32(0)
    for i in range(near.size):
        highest = max(highest, near[i])
        lowest = min(lowest, near[i])
        total += weights[i]
    while lowest < highest:
        middle = min(max(np.int32(guess), lowest), highest - np.int32(1))
        if 2 * _weight_up_to(near, weights, middle) >= total:
            highest = middle
        else:
            lowest = middle + np.int32(1)
        guess = (lowest + highest) >> 1
    return np.int32(lowest)
