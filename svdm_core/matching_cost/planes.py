"""What stage 1 compares: intensities, gradients and census of both views, laid out for one step in memory a disparity.

The right view is matched on the mirrored pair, so both views have the same form: reference pixel x at disparity d
meets column W - 1 - x + d of the other view's mirrored image. Columns in which there is no pixel surround each row;
what meets them costs the most there is, which is what x - d < 0 costs.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Float32, Image, Int16, Uint8
from ..kernels.compilation import kernel
from . import census

INTENSITY = 64 * 255
"""Intensity 1 in the planes: whole 64ths of an 8-bit grey level, exact but for gradient magnitudes."""

NOTHING = np.int16(-(2**15))
"""Stands in every plane of values where there is no pixel; no intensity or gradient is so low."""


class MatchingPlanes(NamedTuple):
    """View 0 is the left image, view 1 the mirrored right one.

    values: int16 (2, C + 1, H, pitch), C intensities and the gradient of the grey image, unit 1 / INTENSITY, or
    (2, C + 1, 0, pitch) where only the census is compared;
    census: uint8 (2, H, NIBBLES, pitch), see `census`, or (2, 0, NIBBLES, pitch) where it is not;
    before: columns in front of column 0 of the image.
    """

    values: Int16
    census: Uint8
    before: int


def empty_planes(
    shape: tuple[int, ...], disparities: range, has_values: bool, has_census: bool
) -> MatchingPlanes:
    """Room for images of `shape` (H, W) or (H, W, C), matched at `disparities` and those that fill up a vector."""
    height, width = shape[:2]
    channels = 1 if len(shape) == 2 else shape[2]
    before, behind = max(0, -disparities.start), max(census.MARGIN, disparities.stop)
    pitch = before + width + behind
    values = np.full((2, channels + 1, height if has_values else 0, pitch), NOTHING, np.int16)
    bits = np.zeros((2, height if has_census else 0, census.NIBBLES, pitch), np.uint8)
    return MatchingPlanes(values, bits, before)


@kernel
def fill_planes(
    planes: MatchingPlanes, view: int, image: Image, grey: Image, scale: tuple[np.float32, np.float32],
    magnitude: bool, rows: tuple[int, int],
) -> None:
    """Take over rows[0] .. rows[1] - 1 of image (H, W, C) and its grey version (H, W), uint8 or uint16.

    scale: the value of the image that is intensity 0, and what a step of 1 is in the planes.
    """
    first, last = rows
    mirrored = view == 1
    offset, unit = scale
    if planes.values.shape[2] > 0:
        for y in range(first, last):
            for c in range(image.shape[2]):
                _fill_intensities(image[y, :, c], offset, unit, mirrored, _of_image(planes, view, c, y, grey))
            _fill_gradient(grey, y, unit, magnitude, mirrored, _of_image(planes, view, image.shape[2], y, grey))
    if planes.census.shape[1] > 0:
        census.fill_census(grey, first, last, mirrored, planes.before, planes.census[view])


@kernel
def _of_image(planes: MatchingPlanes, view: int, plane: int, y: int, grey: Image) -> Int16:
    """The columns of a row of values in which there are pixels."""
    return planes.values[view, plane, y, planes.before:planes.before + grey.shape[1]]


@kernel
def _fill_intensities(row: Image, offset: np.float32, unit: np.float32, mirrored: bool, to: Int16) -> None:
    width = row.size
    for x in range(width):
        value = (np.float32(row[width - 1 - x if mirrored else x]) - offset) * unit
        to[x] = np.int16(np.rint(min(max(value, np.float32(-32000)), np.float32(32000))))


@kernel
def _fill_gradient(grey: Image, y: int, unit: np.float32, magnitude: bool, mirrored: bool, to: Int16) -> None:
    """Signed x difference, halved (eq 3), or magnitude, differences not halved (eq 5); borders replicated."""
    height, width = grey.shape
    row = np.empty(width + 2, np.float32)
    row[0], row[1:-1], row[width + 1] = grey[y, 0], grey[y], grey[y, width - 1]
    slope = np.float32(0.5) * (row[2:] - row[:-2])
    if magnitude:
        above, below = grey[max(y - 1, 0)], grey[min(y + 1, height - 1)]
        for x in range(width):
            along_y = np.float32(below[x]) - np.float32(above[x])
            slope[x] = np.sqrt(np.float32(4) * slope[x] * slope[x] + along_y * along_y)
    for x in range(width):
        value = slope[width - 1 - x if mirrored else x] * unit
        to[x] = np.int16(np.rint(min(max(value, np.float32(-32000)), np.float32(32000))))


def intensities(image: Image, scale: tuple[np.float32, np.float32]) -> Float32:
    """uint8 or uint16 (H, W) or (H, W, 3) as float32 planes (C, H, W); scale as in `fill_planes`, for 0..1."""
    offset, unit = scale
    planes = np.moveaxis(image.reshape(*image.shape[:2], -1), 2, 0).astype(np.float32, order='C')
    return np.asarray((planes - offset) * unit, np.float32)
