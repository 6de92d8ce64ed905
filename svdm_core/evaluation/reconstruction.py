"""How well a disparity map explains the two images it was made from: a figure that needs no ground truth."""
from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from ..kernels.arrays import Bool, Float32, Image
from ..row_alignment.measurement import grey_of

GRADIENT_CUT = 8.0
"""Grey levels; gradients that differ by more do not count more."""
NEIGHBOURS = (9, 7)
"""px, width and height of the window whose order is compared."""
HIDDEN = 0.5
"""Mismatch of a pixel that the right image does not show: about that of unrelated images, so that hiding pays nothing.
"""
DISPARITY_STEP = 1.0
"""px; a larger change between neighbours is a jump."""
IMAGE_STEP = 10.0
"""Grey levels of any channel; a larger change between neighbours is an edge, which explains a jump."""
TEXTURE_STEP = 2.0
"""Grey levels; a pixel whose gradient is as large can be told from its neighbours."""


class Reconstruction(NamedTuple):
    """mismatch, jumps: in % as `reconstruction` has them; smaller is better."""

    mismatch: float
    jumps: float


def reconstruction(disparity: NDArray[np.floating], left: Image, right: Image) -> Reconstruction:
    """How far the right image, moved by a disparity map, is from the left one, and how often the map jumps without
    reason. The idea is that of self-supervised stereo (Godard, Mac Aodha and Brostow 2017): a reconstruction error and
    an edge-aware smoothness.

    The right image is sampled in grey at x - d. The mismatch of a visible pixel is the mean of two terms, each 0 .. 1:
    the difference of the horizontal gradients, cut at GRADIENT_CUT, over GRADIENT_CUT; and the share of its NEIGHBOURS
    that are darker than it in one image and not in the other. That of a hidden pixel is HIDDEN. Whether a pixel is
    hidden is read off the map alone: x - d lies outside, or another pixel that is nearer by more than 1 px lands on the
    same one. `jumps` adds the share of horizontal neighbours and that of vertical ones whose disparities differ by more
    than DISPARITY_STEP where no channel of the left image changes by more than IMAGE_STEP.

    disparity: (H, W), px, dense. left, right: uint8 or uint16, (H, W) or (H, W, 3); 16 bits are stretched to grey
    levels by what the pair uses of them. ValueError where they do not fit, or a disparity is not finite.
    """
    if disparity.ndim != 2 or disparity.shape != left.shape[:2] or left.shape != right.shape:
        raise ValueError(f'disparity {disparity.shape}, left image {left.shape} and right image {right.shape} must '
                         'have the same height and width')
    if disparity.size == 0 or not np.isfinite(disparity).all():
        raise ValueError('the disparity must be dense: every pixel a finite number')
    found = np.asarray(disparity, np.float32)
    left, right = grey_levels(left, right)
    mismatch = np.where(visible(found), _mismatch(found, grey_of(left), grey_of(right)), np.float32(HIDDEN))
    return Reconstruction(100 * float(mismatch.mean(dtype=np.float64)), 100 * _jumps(found, left))


def visible(disparity: Float32) -> Bool:
    """bool (H, W): what the right image shows, judged from the map (H, W) alone."""
    height, width = disparity.shape
    landing = np.rint(np.arange(width, dtype=np.float32) - disparity).astype(np.int64)
    inside = (landing >= 0) & (landing < width)
    place = np.clip(landing, 0, width - 1) + width * np.arange(height)[:, None]
    nearest = np.full(height * width, -np.inf, np.float32)
    np.maximum.at(nearest, place[inside], disparity[inside])
    return np.asarray(inside & (disparity >= nearest[place] - 1))


def textured_share(image: Image) -> float:
    """Share (%) of the pixels whose horizontal gradient is TEXTURE_STEP grey levels or more."""
    return 100 * float((np.abs(_gradient(grey_of(image).astype(np.float32))) >= TEXTURE_STEP).mean())


def grey_levels(left: Image, right: Image) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]:
    """A pair as uint8, (H, W) or (H, W, 3): 16 bits are stretched by what the pair uses of them, but for the outermost.
    """
    if left.dtype == np.uint8:
        return left, right
    low, high = np.percentile(np.stack([left, right]), (0.5, 99.5))
    scale = 255 / max(high - low, 1.0)
    first, second = (np.clip((image - low) * scale, 0, 255).astype(np.uint8) for image in (left, right))
    return first, second


def _mismatch(disparity: Float32, left: NDArray[np.uint8], right: NDArray[np.uint8]) -> Float32:
    own = left.astype(np.float32)
    moved = _sampled(right, np.arange(disparity.shape[1], dtype=np.float32) - disparity)
    gradient = np.minimum(np.abs(_gradient(own) - _gradient(moved)), GRADIENT_CUT) / GRADIENT_CUT
    return np.asarray((gradient + _order(own, moved)) / 2, np.float32)


def _sampled(image: NDArray[np.uint8], x: Float32) -> Float32:
    """The rows at x, px: linear between pixels, the outermost ones beyond the border. cv2.remap would round x to 1/32.
    """
    width = image.shape[1]
    x = np.clip(x, 0, width - 1)
    first = np.minimum(x.astype(np.int64), max(width - 2, 0))
    rows = np.arange(image.shape[0])[:, None]
    before, after = image[rows, first].astype(np.float32), image[rows, np.minimum(first + 1, width - 1)]
    return np.asarray(before + (x - first) * (after - before), np.float32)


def _gradient(grey: Float32) -> Float32:
    """Central differences along the row, grey levels a px."""
    wide = cv2.copyMakeBorder(grey, 0, 0, 1, 1, cv2.BORDER_REPLICATE)
    return np.asarray((wide[:, 2:] - wide[:, :-2]) / 2, np.float32)


def _order(one: Float32, other: Float32) -> Float32:
    """Share of the NEIGHBOURS whose order to the pixel differs, (H, W); beyond the border the outermost pixels are
    repeated."""
    across, down = NEIGHBOURS[0] // 2, NEIGHBOURS[1] // 2
    height, width = one.shape
    wide = [cv2.copyMakeBorder(image, down, down, across, across, cv2.BORDER_REPLICATE) for image in (one, other)]
    count = np.zeros((height, width), np.uint8)
    for dy in range(2 * down + 1):
        for dx in range(2 * across + 1):
            a, b = (image[dy:dy + height, dx:dx + width] for image in wide)
            count += (a < one) != (b < other)
    return np.asarray(count / np.float32(NEIGHBOURS[0] * NEIGHBOURS[1] - 1), np.float32)


def _jumps(disparity: Float32, image: NDArray[np.uint8]) -> float:
    levels = image.astype(np.int32)
    total = 0.0
    for axis in (0, 1):
        if disparity.shape[axis] < 2:
            continue
        change = np.abs(np.diff(levels, axis=axis))
        plain = (change if change.ndim == 2 else change.max(axis=2)) <= IMAGE_STEP
        total += float(((np.abs(np.diff(disparity, axis=axis)) > DISPARITY_STEP) & plain).mean())
    return total
