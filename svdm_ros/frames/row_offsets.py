"""How far the rows of a pair are apart that should be rectified: corners of the left image, found in the right one."""
from __future__ import annotations

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    Grey = NDArray[np.uint8]
    Floats = NDArray[np.floating[Any]]

_MOST_FEATURES, _FEWEST_FEATURES = 160, 20
_WORK = 8000
"""Features times columns searched: a wide search has fewer features."""
_QUALITY = 0.005
"""Least strength of a corner, relative to the strongest."""
_SHRINK = 2
"""Features are searched in images shrunk by this factor, and located in the full ones."""
_TEMPLATE, _ROWS = 5, 6
"""Templates are 11 x 11 px, and searched 6 rows up and down; px of the shrunk images."""
_PATCH = 8
"""Features are located by patches of 17 x 17 px."""
_STEPS, _STILL, _FURTHEST = 5, 0.1, 2.5
"""Steps of the location; px of the last one at most; px from where the search found the feature, at most."""
_CORRELATION = 0.8
_SHARE_FOUND = 0.3
"""What is found of a scene that the other image does not show is found by chance, and is less than this share."""
_FITS, _FAR, _SPREADS = 8, 0.75, 4.0
"""Fits of the plane; px from it that are never too far; medians of the distances that are."""
_LARGEST = 1 << 14
"""Pixels beyond this row or column are not looked at."""

_ENOUGH, _KEPT = 3, 5
_MEDIAN_ALLOWED, _P90_ALLOWED = 0.5, 1.5
"""px; rectified pairs of KITTI and Middlebury stay below 0.35 and 1.0."""


class RowOffsets(NamedTuple):
    """y_right - y_left in a pair, px: median, 90th percentile of the absolute values; of how many features."""

    median: float
    p90: float
    features: int


class _Features(NamedTuple):
    """One row for each feature, (x, y) in px, int: where it is in the left and about where it is in the right image."""

    left: NDArray[np.intp]
    right: NDArray[np.intp]


class _Located(NamedTuple):
    """For each feature: x and y in the right image minus those in the left, px; how long the last step was, px; the
    correlation of the two patches."""

    offset: Floats
    step: Floats
    correlation: Floats


def row_offsets(left: NDArray[Any], right: NDArray[Any], search: tuple[int, int]) -> RowOffsets | None:
    """How far rows are apart; None where fewer than 20 features, or three in ten of those looked for, are found again.

    left, right: uint8 or uint16, (H, W) or (H, W, 3). search: smallest and largest disparity, px. Offsets of up to
    about 10 px are found. The same images give the same result. Raises nothing for images of 1x1 px and more.
    """
    if left.shape[:2] != right.shape[:2] or min(left.shape[:2]) < 2 * _SHRINK * (2 * _TEMPLATE + 1):
        return None
    left_grey, right_grey = _grey(left), _grey(right)
    looked_for, features = _found(_shrunk(left_grey), _shrunk(right_grey), search)
    if len(features.left) < _FEWEST_FEATURES:
        return None
    located = _located(left_grey, right_grey, features)
    moved = located.offset - (features.right - features.left)
    disparity = -located.offset[:, 0]
    good = ((located.correlation >= _CORRELATION) & (located.step <= _STILL) & (np.abs(moved).max(1) <= _FURTHEST)
            & (disparity >= search[0] - 1) & (disparity <= search[1] + 1))
    if good.sum() < max(_FEWEST_FEATURES, _SHARE_FOUND * looked_for):
        return None
    offsets = _alike(features.left[good], located.offset[good, 1])
    if len(offsets) < _FEWEST_FEATURES:
        return None
    return RowOffsets(float(np.median(offsets)), float(np.percentile(np.abs(offsets), 90)), len(offsets))


def _grey(image: NDArray[Any]) -> Grey:
    """uint8 (H, W); 16 bits are stretched from the darkest to the brightest but the outermost of them."""
    image = np.ascontiguousarray(image[:_LARGEST, :_LARGEST])
    grey: NDArray[Any] = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)) if image.ndim == 3 else image
    if grey.dtype == np.uint8:
        return grey
    low, high = np.percentile(grey[::8, ::8], (0.5, 99.5))
    above = np.maximum(grey, np.uint16(low)) - np.uint16(low)
    return np.asarray(cv2.convertScaleAbs(above, alpha=255 / max(high - low, 1)), np.uint8)


def _shrunk(grey: Grey) -> Grey:
    height, width = grey.shape[0] // _SHRINK, grey.shape[1] // _SHRINK
    whole = np.ascontiguousarray(grey[:height * _SHRINK, :width * _SHRINK])
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA), np.uint8)


# The search, in shrunk images


def _found(left: Grey, right: Grey, search: tuple[int, int]) -> tuple[int, _Features]:
    """How many corners of `left` were looked for, and those found in `right` and from there in `left` again."""
    low, high = math.floor(search[0] / _SHRINK) - 1, math.ceil(search[1] / _SHRINK) + 1
    corners = _corners(left, max(_FEWEST_FEATURES * 3, min(_MOST_FEATURES, _WORK // (high - low + 1))))
    pairs = []
    for corner in corners:
        there = _best(left, right, corner, (-high, -low))
        back = None if there is None else _best(right, left, there, (low, high))
        if there is not None and back is not None and max(abs(back[0] - corner[0]), abs(back[1] - corner[1])) <= 1:
            pairs.append((corner, there))
    places = np.array(pairs, np.intp).reshape(-1, 2, 2) * _SHRINK
    return len(corners), _Features(places[:, 0], places[:, 1])


def _corners(image: Grey, count: int) -> list[tuple[int, int]]:
    """(x, y) of the strongest corners, spread over the image."""
    distance = math.sqrt(image.size / (2 * count))
    corners: NDArray[Any] | None = cv2.goodFeaturesToTrack(image, count, _QUALITY, distance)
    return [] if corners is None else [(int(x), int(y)) for x, y in corners.reshape(-1, 2)]


def _best(
    source: Grey, target: Grey, place: tuple[int, int], columns: tuple[int, int]
) -> tuple[int, int] | None:
    """Where `target` looks most like `source` at `place`, from columns[0] to columns[1] px to the right of it.

    None where that is at the rim of the search, so that the best may be beyond, or too near to the rim of the image.
    """
    height, width = source.shape
    x, y = place
    near, far = max(x + columns[0], _TEMPLATE), min(x + columns[1], width - 1 - _TEMPLATE)
    top, bottom = max(y - _ROWS, _TEMPLATE), min(y + _ROWS, height - 1 - _TEMPLATE)
    if not (_TEMPLATE <= x < width - _TEMPLATE and _TEMPLATE <= y < height - _TEMPLATE) or far - near < 2:
        return None
    template = source[y - _TEMPLATE:y + _TEMPLATE + 1, x - _TEMPLATE:x + _TEMPLATE + 1]
    strip = target[top - _TEMPLATE:bottom + _TEMPLATE + 1, near - _TEMPLATE:far + _TEMPLATE + 1]
    _, score, _, (column, row) = cv2.minMaxLoc(cv2.matchTemplate(strip, template, cv2.TM_CCOEFF_NORMED))
    if not math.isfinite(score) or column in (0, far - near) or row in (0, bottom - top):
        return None
    return near + column, top + row


# The location, in full images


def _located(left: Grey, right: Grey, features: _Features) -> _Located:
    """Lucas and Kanade's steps for all features at once, on patches brought to mean 0 and length 1.

    So neither a different exposure nor a different black level of the two cameras moves a feature.
    """
    wide = _patches(left, features.left.astype(np.float32), _PATCH + 1)
    patch, contrast = _normal(wide[:, 1:-1, 1:-1])
    slopes = np.stack((wide[:, 1:-1, 2:] - wide[:, 1:-1, :-2], wide[:, 2:, 1:-1] - wide[:, :-2, 1:-1]), 1) / 2
    slopes -= slopes.mean((2, 3), keepdims=True)
    slopes = slopes.reshape(len(patch), 2, -1) / contrast[:, None, None]
    inverse = _inverse(slopes @ slopes.transpose(0, 2, 1))
    place: Floats = features.right.astype(np.float32)
    for _ in range(_STEPS):
        seen, _ = _normal(_patches(right, place, _PATCH))
        step = (inverse @ (slopes @ (patch - seen)[:, :, None]))[:, :, 0]
        step = np.clip(step, -1, 1)
        place = place + step
    seen, _ = _normal(_patches(right, place, _PATCH))
    offset = place - features.left.astype(np.float32)
    return _Located(offset, np.abs(step).max(1), (patch * seen).sum(1))


def _patches(image: Grey, centres: Floats, radius: int) -> Floats:
    """(N, 2 radius + 1, 2 radius + 1) grey levels around centres (x, y), bilinear; outside is as the rim."""
    whole = np.floor(centres)
    across, down = ((centres - whole)[:, axis, None, None] for axis in (0, 1))
    reach = np.arange(-radius, radius + 2)
    columns = np.clip(whole[:, 0, None].astype(np.intp) + reach, 0, image.shape[1] - 1)
    rows = np.clip(whole[:, 1, None].astype(np.intp) + reach, 0, image.shape[0] - 1)
    grey = image.ravel()[rows[:, :, None] * image.shape[1] + columns[:, None, :]].astype(np.float32)
    upright = grey[:, :-1] + down * (grey[:, 1:] - grey[:, :-1])
    return np.asarray(upright[:, :, :-1] + across * (upright[:, :, 1:] - upright[:, :, :-1]), np.float32)


def _normal(patches: Floats) -> tuple[Floats, Floats]:
    """Patches as rows (N, pixels) of mean 0 and length 1, and what they were divided by (N); at least 1 grey level."""
    rows = patches.reshape(len(patches), -1)
    rows = rows - rows.mean(1, keepdims=True)
    length = np.maximum(np.sqrt((rows * rows).sum(1)), 1.0)
    return rows / length[:, None], length


def _inverse(matrices: Floats) -> Floats:
    """Inverses of symmetric (N, 2, 2); those of patches that have an edge but no corner are small, not infinite."""
    a, b, c = matrices[:, 0, 0], matrices[:, 0, 1], matrices[:, 1, 1]
    determinant = np.maximum(a * c - b * b, 1e-6)
    return np.stack((c, -b, -b, a), 1).reshape(-1, 2, 2) / determinant[:, None, None]


# Outliers


def _alike(places: NDArray[np.intp], offsets: Floats) -> NDArray[np.float64]:
    """The offsets without those far off a plane over the image, which has what a wrong rectification does.

    A corner of two edges at different depths is at another height in the other view, however well both are rectified.
    """
    across = (places - places.mean(0)) / np.maximum(np.ptp(places, axis=0), 1)
    terms = np.column_stack((np.ones(len(places)), across))
    wanted = offsets.astype(np.float64)
    far = np.abs(wanted - np.median(wanted))
    for _ in range(_FITS):
        weights = 1 / (far + _FAR / 10)  # of squares, so that distances count, not their squares
        weighted = terms * weights[:, None]
        plane = np.linalg.lstsq(weighted.T @ terms, weighted.T @ wanted, rcond=None)[0]
        far = np.abs(wanted - terms @ plane)
    return wanted[far <= max(_FAR, _SPREADS * float(np.median(far)))]


_LATE = 4
"""Periods after which a measurement is old."""


class RectificationCheck:
    """Measures a pair now and then, and says when the cameras are not rectified, or no longer.

    `look` is for one thread; `line` and `values` are for any.
    """

    def __init__(self, period: float = 5.0) -> None:
        """period: least time between two measurements, s."""
        self._period = period
        self._next = -math.inf
        self._looked = -math.inf
        self._setting: object = None
        self._results: tuple[RowOffsets | None, ...] = ()

    def look(
        self, left: NDArray[Any], right: NDArray[Any], search: tuple[int, int], now: float, setting: object = None
    ) -> None:
        """Measure the pair if it is time to; `now` in s, of a clock that runs evenly. The rest: see `row_offsets`.

        Where the size of the images changes, or the `setting`, what was measured before counts no more.
        """
        setting = left.shape[:2], setting
        if setting == self._setting and now < self._next:
            return
        before = self._results if setting == self._setting else ()
        self._setting, self._looked, self._next = setting, now, now + self._period
        self._results = (*before, row_offsets(left, right, search))[-_KEPT:]

    def line(self, now: float) -> str:
        """What is wrong and what to do; empty: nothing, nothing of late, or fewer than 3 of the last 5 pairs could be
        measured."""
        found, pooled = self._pooled()
        if now - self._looked > _LATE * self._period or found < _ENOUGH:
            return ''
        if abs(pooled.median) <= _MEDIAN_ALLOWED and pooled.p90 <= _P90_ALLOWED:
            return ''
        where = 'lower' if pooled.median > 0 else 'higher'
        return (f'rows do not correspond: features are {abs(pooled.median):.2f} px {where} in the right image in the '
                f'median ({_MEDIAN_ALLOWED:g} is allowed), 90 % of them at most {pooled.p90:.2f} px off '
                f'({_P90_ALLOWED:g} is allowed; {pooled.features} features of {found} pairs): check that the images '
                'are rectified (if they are raw: `input: raw`), or calibrate the cameras anew')

    def values(self) -> dict[str, str]:
        """For diagnostics; empty while nothing was measured."""
        found, pooled = self._pooled()
        return {} if not found else {
            'vertical offset (px)': f'{pooled.median:.2f}',
            'vertical offset p90 (px)': f'{pooled.p90:.2f}',
            'features': str(pooled.features),
        }

    def _pooled(self) -> tuple[int, RowOffsets]:
        """How many of the last pairs could be measured; medians of their medians and 90th percentiles, all features."""
        results = [result for result in self._results if result is not None]
        if not results:
            return 0, RowOffsets(0.0, 0.0, 0)
        medians, p90s, counts = zip(*results, strict=True)
        return len(results), RowOffsets(float(np.median(medians)), float(np.median(p90s)), sum(counts))
