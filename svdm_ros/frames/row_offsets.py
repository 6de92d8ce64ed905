"""Whether the rows of a pair correspond that should be rectified: what is said where they do not."""
from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from svdm_core.row_alignment.alignment import RowAlignment, RowPoints, terms
from svdm_core.row_alignment.fitting import robust_fit
from svdm_core.row_alignment.measurement import grey_of, measured

_ROWS = 12
"""Rows searched up and down: offsets of up to 11 px are seen."""
_MOST_CORNERS, _FEWEST = 200, 20
"""Of corners looked for, of those found again."""
_WORK = 16000
"""Corners times columns searched: a wide search has fewer corners."""
_PLANE = 3
"""Terms of the field that points are not to be far off."""
_LARGEST = 1 << 14
"""Pixels beyond this row or column are not looked at."""
_ENOUGH, _KEPT = 3, 5
_MEDIAN_ALLOWED, _P90_ALLOWED = 0.5, 1.5
"""px; rectified pairs of KITTI and Middlebury stay below 0.35 and 1.0."""
_LATE = 4
"""Periods after which a measurement is old."""


class RowOffsets(NamedTuple):
    """y_right - y_left in a pair, px: median, 90th percentile of the absolute values; of how many features."""

    median: float
    p90: float
    features: int


def row_points(left: NDArray[Any], right: NDArray[Any], search: tuple[int, int]) -> RowPoints | None:
    """Where rows are apart, and by how much; None where fewer than 20 features are found again.

    left, right: uint8 or uint16, (H, W) or (H, W, 3). search: smallest and largest disparity, px. Offsets of up to 11
    px are found. Left out is what is far off a plane over the image, which has what a wrong rectification does: a
    corner of two edges at different depths is at another height in the other view, however well both are rectified.
    The same images give the same result. Raises nothing for images of 1x1 px and more.
    """
    if left.shape[:2] != right.shape[:2]:
        return None
    left_grey, right_grey = (grey_of(np.ascontiguousarray(image[:_LARGEST, :_LARGEST])) for image in (left, right))
    columns = min(search[1] - search[0] + 1, left.shape[1])
    most = max(3 * _FEWEST, min(_MOST_CORNERS, _WORK // columns))
    points = measured(left_grey, right_grey, search, most, furthest=_ROWS - 1.0, rows=_ROWS)
    if points.size < _FEWEST:
        return None
    basis = terms(points.x_right, points.y, left.shape)
    near = robust_fit(basis, points.dy, np.zeros(basis.shape[1]), _PLANE, left.shape).weights > 0
    kept = RowPoints(*(values[near] for values in points))
    return kept if kept.size >= _FEWEST else None


def row_offsets(points: RowPoints, rows: RowAlignment | None = None) -> RowOffsets:
    """How far the rows are apart; with `rows`, by which the right image is aligned, how far they are apart then."""
    dy = points.dy if rows is None else points.dy - rows.offsets(points.x_right, points.y)
    return RowOffsets(float(np.median(dy)), float(np.percentile(np.abs(dy), 90)), points.size)


class RectificationCheck:
    """Measures a pair now and then, and says when the cameras are not rectified, or no longer.

    `look` is for one thread; all else is for any.
    """

    def __init__(self, period: float = 5.0) -> None:
        """period: least time between two measurements, s."""
        self._period = period
        self._looked = -math.inf
        self._points: tuple[RowPoints | None, ...] = ()

    def is_due(self, now: float) -> bool:
        """Whether it is time to measure a pair; `now` in s, of a clock that runs evenly."""
        return now >= self._looked + self._period

    def look(self, left: NDArray[Any], right: NDArray[Any], search: tuple[int, int], now: float) -> None:
        """Measure a pair as the cameras gave it (not aligned), whether due or not; see `row_points`."""
        self._looked = now
        self._points = (*self._points, row_points(left, right, search))[-_KEPT:]

    def line(self, now: float, rows: RowAlignment | None = None) -> str:
        """What is wrong and what to do; empty: nothing, nothing of late, or fewer than 3 of the last 5 pairs could be
        measured. rows: what the right images are aligned by, if they are: it is wrong no more."""
        found, pooled = self._pooled(rows)
        if now - self._looked > _LATE * self._period or found < _ENOUGH:
            return ''
        if abs(pooled.median) <= _MEDIAN_ALLOWED and pooled.p90 <= _P90_ALLOWED:
            return ''
        where = 'lower' if pooled.median > 0 else 'higher'
        return (f'rows do not correspond: features are {abs(pooled.median):.2f} px {where} in the right image in the '
                f'median ({_MEDIAN_ALLOWED:g} is allowed), 90 % of them at most {pooled.p90:.2f} px off '
                f'({_P90_ALLOWED:g} is allowed; {pooled.features} features of {found} pairs): check that the images '
                'are rectified (if they are raw: `input: raw`), or calibrate the cameras anew')

    def values(self, rows: RowAlignment | None = None) -> dict[str, str]:
        """For diagnostics; empty while nothing was measured. rows: as in `line`."""
        found, pooled = self._pooled(rows)
        return {} if not found else {
            'vertical offset (px)': f'{pooled.median:.2f}',
            'vertical offset p90 (px)': f'{pooled.p90:.2f}',
            'features': str(pooled.features),
        }

    def _pooled(self, rows: RowAlignment | None) -> tuple[int, RowOffsets]:
        """How many of the last pairs could be measured; medians of their medians and 90th percentiles, all features."""
        results = [row_offsets(points, rows) for points in self._points if points is not None]
        if not results:
            return 0, RowOffsets(0.0, 0.0, 0)
        medians, p90s, counts = zip(*results, strict=True)
        return len(results), RowOffsets(float(np.median(medians)), float(np.median(p90s)), sum(counts))
