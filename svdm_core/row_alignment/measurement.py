"""Where in the right image, in which row, corners of the left one are found again."""
from __future__ import annotations

import math
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..kernels.arrays import Image, Uint8
from .alignment import NO_POINTS, RowPoints

MOST_CORNERS = 1500
_QUALITY = 0.005
"""Least strength of a corner, relative to the strongest."""
_APART = 7
"""px between corners."""
_PATCH = 5
"""Patches are 11 x 11 px."""
ROWS = 8
"""Rows searched up and down: far more than is believed, so that what repeats is seen to."""
FURTHEST = 2.0
"""px, largest offset that is believed."""
FURTHEST_SEEN = ROWS - 1.0
"""px, largest offset that can be seen, of pairs that are far from rectified."""
_ALIKE = 0.9
"""Least correlation of two patches."""
_AROUND, _BETTER = 2, 0.05
"""The best place is better by so much than all places farther away than so many px: nothing is taken that repeats."""
_CONTRAST = 2.0
"""Grey levels, least standard deviation of a patch."""
_COLUMNS = 6
"""Least number of columns that are searched, where the search range is not narrower."""


def measure_rows(
    left: Image, right: Image, min_disparity: int, num_disparities: int, most: int = MOST_CORNERS,
) -> RowPoints:
    """The vertical offset at corners of the left image; none where nothing is found.

    left, right: uint8 or uint16, (H, W) or (H, W, 3), of any one size. The search range is min_disparity ..
    min_disparity + num_disparities - 1, px. most: corners looked for. The same images give the same points. Offsets of
    up to 2 px are found. Raises ValueError where the sizes differ.
    """
    if left.shape[:2] != right.shape[:2]:
        raise ValueError(f'left image {left.shape[1]} x {left.shape[0]} px and right image {right.shape[1]} x '
                         f'{right.shape[0]} px must have the same size')
    return measured(grey_of(left), grey_of(right), (min_disparity, min_disparity + num_disparities - 1), most)


def grey_of(image: Image) -> Uint8:
    """uint8 (H, W); 16 bits are stretched from the darkest to the brightest but the outermost of them."""
    grey: NDArray[Any] = np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)) if image.ndim == 3 else image
    if grey.dtype == np.uint8:
        return np.ascontiguousarray(grey)
    low, high = np.percentile(grey, (0.5, 99.5))
    levels: Uint8 = np.clip((grey - low) * (255 / max(high - low, 1.0)), 0, 255).astype(np.uint8)
    return levels


class _Strip(NamedTuple):
    """The part of the right image where a patch is searched: so many rows up and down, columns from `first` on."""

    pixels: Uint8
    first: int
    rows: int


def measured(
    left: Uint8, right: Uint8, search: tuple[int, int], most: int = MOST_CORNERS, furthest: float = FURTHEST,
    rows: int = ROWS,
) -> RowPoints:
    """`measure_rows` of grey images (H, W); search: smallest and largest disparity; furthest: largest offset, px, below
    `rows`, which are searched up and down."""
    if left.shape[0] < 2 * (_PATCH + rows) + 1 or left.shape[1] < 2 * _PATCH + 1:
        return NO_POINTS
    corners: NDArray[Any] | None = cv2.goodFeaturesToTrack(left, most, _QUALITY, _apart(left, most))
    if corners is None:
        return NO_POINTS
    found = []
    for x, y in corners.reshape(-1, 2).astype(np.intp).tolist():
        strip = _strip(right, (x, y), search, rows)
        place = None if strip is None else _found(left[y - _PATCH:y + _PATCH + 1, x - _PATCH:x + _PATCH + 1], strip)
        if place is not None and abs(place[1]) <= furthest:
            found.append((place[0], y, place[1]))
    return RowPoints(*np.array(found, np.float64).reshape(-1, 3).T.copy())


def _apart(image: Uint8, most: int) -> float:
    """px between corners: where only few are wanted, they are spread over the image."""
    return _APART if most >= MOST_CORNERS else max(_APART, math.sqrt(image.size / (4 * most)))


def _strip(right: Uint8, corner: tuple[int, int], search: tuple[int, int], rows: int) -> _Strip | None:
    """None for a corner (x, y) too near to the rim, or with next to nothing to be searched."""
    x, y = corner
    height, width = right.shape
    if not (_PATCH <= x < width - _PATCH and _PATCH + rows <= y < height - _PATCH - rows):
        return None
    first, last = max(x - search[1], _PATCH), min(x - search[0], width - 1 - _PATCH)
    if last - first + 1 < min(_COLUMNS, search[1] - search[0] + 1):
        return None
    reach = _PATCH + rows
    return _Strip(right[y - reach:y + reach + 1, first - _PATCH:last + _PATCH + 1], first, rows)


def _found(patch: Uint8, strip: _Strip) -> tuple[int, float] | None:
    """Column and vertical offset of the place most like `patch`; None where it is none to be believed."""
    if patch.std() < _CONTRAST:
        return None
    alike = cv2.matchTemplate(strip.pixels, patch, cv2.TM_CCOEFF_NORMED)
    row, column = divmod(int(alike.argmax()), alike.shape[1])
    best = float(alike[row, column])
    offset = row - strip.rows
    if not _ALIKE <= best <= 1.01 or abs(offset) == strip.rows:  # flat places may have any number, NaN too
        return None
    # A flat place is like anything.
    if strip.pixels[row:row + 2 * _PATCH + 1, column:column + 2 * _PATCH + 1].std() < _CONTRAST:
        return None
    above, below = float(alike[row - 1, column]), float(alike[row + 1, column])
    alike[max(0, row - _AROUND):row + _AROUND + 1, max(0, column - _AROUND):column + _AROUND + 1] = -1
    if not alike.max() <= best - _BETTER:
        return None
    bend = above - 2 * best + below  # of the parabola through the three
    dy = offset + (0.5 * (above - below) / bend if bend < 0 else 0.0)
    return strip.first + column, dy
