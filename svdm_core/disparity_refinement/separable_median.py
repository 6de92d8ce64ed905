"""The weighted median of stage 4 where the guide is the disparity itself: the same medians, much sooner.

The weight between labels then depends on two labels only, so a pixel's histogram is a Gaussian histogram of its
window, which separates into columns and rows, times one row of a table. It is summed in float32; where that could
round to another median than the whole weights of `weighted_median` give, the pixel is left to that one.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Bool, Float32, Int32, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.tasks import do_tasks, share
from ..kernels.vectors import lane_sum, load, pointer, splat, store

# float32 in a vector: labels are counted in whole vectors.
_LANES = 16

# Rows worked on by one task.
_ROWS = 8

# Most that a weight of `weighted_median` is off, in its units: the polynomial of its exponential, and the rounding.
WEIGHT_ERROR = 3.0

# The same for float32 sums over a window, relative to the sum.
_SUM_ERROR = 5e-6


def separable_median(
    labels: Int32, window: int, sigma_s: float, sigma_label: float, scale: float
) -> tuple[Int32, Bool]:
    """Medians of int32 (H, W) labels l >= 0, weighted by exp(-|p - q|^2 / sigma_s^2 - (l_p - l_q)^2 / sigma_label^2).

    window: side, px, odd; sigma_s: px; sigma_label: labels; scale: what weight 1 is in `weighted_median`. Returns
    medians, int32 (H, W), and where they are certain to be those of `weighted_median`, bool (H, W).
    """
    lowest = int(labels.min())
    bins = -(-(int(labels.max()) - lowest + 1) // _LANES) * _LANES
    near = np.exp(-((np.arange(window) - window // 2) / sigma_s) ** 2).astype(np.float32)
    alike = np.exp(-(np.arange(-bins, bins) / sigma_label) ** 2).astype(np.float32)
    medians, certain = np.empty(labels.shape, np.int32), np.empty(labels.shape, np.bool_)
    error = np.float32(2 * WEIGHT_ERROR * window**2 / scale)
    do_tasks(_take_medians, -(-labels.shape[0] // _ROWS), labels, _Weights(lowest, bins, near, alike, error), medians,
             certain)
    return medians, certain


class _Weights(NamedTuple):
    """Of `bins` labels from `lowest` on: near, float32 (window), by the distance along an axis; alike, float32
    (2 * bins), by the difference of labels + bins. error: what a sum may be off."""

    lowest: int
    bins: int
    near: Float32
    alike: Float32
    error: np.float32


@kernel
def _take_medians(
    counter: Int64, end: int, arenas: Uint8, labels: Int32, weights: _Weights, medians: Int32, certain: Bool
) -> None:
    share(_medians_of_rows, counter, end, arenas, (labels, weights, medians, certain))


@kernel
def _medians_of_rows(
    task: int, _arena: Uint8, labels: Int32, weights: _Weights, medians: Int32, certain: Bool
) -> None:
    height, width = labels.shape
    columns, histogram = np.empty(width * weights.bins, np.float32), np.empty(weights.bins, np.float32)
    for y in range(task * _ROWS, min(height, (task + 1) * _ROWS)):
        _column_histograms(labels, y, weights, columns)
        _medians_of_row(labels[y], weights, columns, histogram, medians[y], certain[y])


@kernel
def _column_histograms(labels: Int32, y: int, weights: _Weights, columns: Float32) -> None:
    """columns[x * bins + b]: weight of the pixels with label lowest + b above and below (y, x), and of itself."""
    height, width = labels.shape
    lowest, bins, near = weights.lowest, weights.bins, weights.near
    r = near.size // 2
    columns[:] = 0
    at = pointer(columns)
    for row in range(max(0, y - r), min(height, y + r + 1)):
        weight, there = near[row - y + r], labels[row]
        for x in range(width):
            at[x * bins + there[x] - lowest] += weight


@kernel
def _medians_of_row(
    labels: Int32, by: _Weights, columns: Float32, histogram: Float32, medians: Int32, certain: Bool
) -> None:
    lowest, bins, near, alike = by.lowest, by.bins, by.near, by.alike
    width, r = labels.size, near.size // 2
    columns_at, histogram_at, near_at, alike_at = pointer(columns), pointer(histogram), pointer(near), pointer(alike)
    for x in range(width):
        own = labels[x] - lowest
        everything = splat(np.float32(0))
        for b in range(0, bins, _LANES):
            weights = splat(np.float32(0))
            for column in range(max(0, x - r), min(width, x + r + 1)):
                weights = weights + splat(near_at[column - x + r]) * load(columns_at, column * bins + b)
            weights = weights * load(alike_at, bins - own + b)
            store(histogram_at, b, weights)
            everything = everything + weights
        half = np.float32(0.5) * lane_sum(everything)
        below, first = np.float32(0), 0
        while first < bins - _LANES:
            weight = lane_sum(load(histogram_at, first))
            if below + weight >= half:
                break
            below += weight
            first += _LANES
        label = first
        while label < bins - 1 and below + histogram_at[label] < half:
            below += histogram_at[label]
            label += 1
        medians[x] = label + lowest
        margin = by.error + np.float32(2 * _SUM_ERROR) * half
        certain[x] = half - below > margin and below + histogram_at[label] - half > margin
