"""What is made of a pair before stage 1: 8-bit levels, grey images, planes; by blocks of rows of either view."""
from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from ..kernels.arrays import Image, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.stripes import BLOCK
from ..kernels.tasks import share
from .intensity_range import IntensityRange
from .planes import MatchingPlanes, fill_planes


class PairImages(NamedTuple):
    """left, right: (H, W, C) uint8 or uint16, C 1 or 3 (BGR); left_grey, right_grey: (H, W) of the same type, the
    images themselves where C is 1. levels: uint8 (C, H, W), the left one in levels of 8 bits.

    offset, gain: of `IntensityRange`; level_offset, level_gain, level_unit: of `Levels`.
    """

    left: Image
    right: Image
    left_grey: Image
    right_grey: Image
    levels: Uint8
    offset: np.float32
    gain: np.float32
    level_offset: np.float32
    level_gain: np.float32
    level_unit: np.float32


@kernel
def fill_levels(counter: Int64, end: int, arenas: Uint8, images: PairImages) -> None:
    """Blocks of rows of either view: grey images, and the levels of the left one."""
    share(_fill_level_block, counter, end, arenas, (images,))


@kernel
def _fill_level_block(task: int, _arena: Uint8, images: PairImages) -> None:
    blocks = (images.left.shape[0] + BLOCK - 1) // BLOCK
    view, block = task // blocks, task % blocks
    image, grey = (images.left, images.left_grey) if view == 0 else (images.right, images.right_grey)
    for y in range(block * BLOCK, min(image.shape[0], (block + 1) * BLOCK)):
        if image.shape[2] == 3:
            _grey_row(image[y], grey[y])
        for c in range(image.shape[2]):
            if view == 0:
                _level_row(image[y, :, c], images.level_offset, images.level_gain, images.levels[c, y])


@kernel
def _grey_row(row: Image, grey: Image) -> None:
    """The weights of ITU-R BT.601 in 15 bits, as OpenCV has them."""
    for x in range(grey.size):
        total = np.int64(3735) * row[x, 0] + np.int64(19235) * row[x, 1] + np.int64(9798) * row[x, 2]
        grey[x] = (total + 16384) >> 15


@kernel
def _level_row(row: Image, offset: np.float32, gain: np.float32, levels: Uint8) -> None:
    for x in range(levels.size):
        value = np.rint((np.float32(row[x]) - offset) * gain)
        levels[x] = np.uint8(min(max(value, np.float32(0)), np.float32(255)))


@kernel
def fill_plane_blocks(
    counter: Int64, end: int, arenas: Uint8, images: PairImages, planes: MatchingPlanes, unit: np.float32,
    magnitude: bool,
) -> None:
    """Blocks of rows of either view: planes of values and census; unit: what intensity 1 is in them."""
    share(_fill_block, counter, end, arenas, (images, planes, unit, magnitude))


@kernel
def _fill_block(
    task: int, _arena: Uint8, images: PairImages, planes: MatchingPlanes, unit: np.float32, magnitude: bool
) -> None:
    height = images.left.shape[0]
    blocks = (height + BLOCK - 1) // BLOCK
    view, block = task // blocks, task % blocks
    rows, scale = (block * BLOCK, min(height, (block + 1) * BLOCK)), (images.offset, images.gain * unit)
    if view == 0:
        fill_planes(planes, view, images.left, images.left_grey, scale, magnitude, rows)
    else:
        fill_planes(planes, view, images.right, images.right_grey, scale, magnitude, rows)


def images_of(left: Image, right: Image, found: IntensityRange, kept: PairImages | None) -> PairImages:
    """A pair (H, W) or (H, W, 3) with room for its levels and grey images: that of the pair before where it fits."""
    views = [image.reshape(*image.shape[:2], -1) for image in (left, right)]
    height, width, channels = views[0].shape
    if kept is None or kept.left.shape != views[0].shape or kept.left.dtype != left.dtype:
        levels = np.zeros((channels, height, width), np.uint8)
        grey = tuple(np.zeros((2, height, width) if channels == 3 else (2, 0, 0), left.dtype))
    else:
        levels, grey = kept.levels, (kept.left_grey, kept.right_grey)
    greys = (grey[0], grey[1]) if channels == 3 else (left, right)
    offset, gain, level_offset, level_gain, level_unit = map(np.float32, (*found, *found.levels(left.dtype)))
    return PairImages(views[0], views[1], greys[0], greys[1], levels, offset, gain, level_offset, level_gain,
                      level_unit)


def smoothed_guide(image: Image, side: int) -> Image:
    """The image (H, W, C) through a median of side x side px, from which trees are made."""
    return image if side == 1 else np.asarray(cv2.medianBlur(image, side)).reshape(image.shape)
