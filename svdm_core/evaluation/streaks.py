"""How streaky a disparity map is: a figure that needs no ground truth."""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from ..kernels.arrays import Bool, Image

DISPARITY_STEP = 1.0
"""px; a larger change from one row to the next ends a layer."""

THICKNESS = 8
"""rows; a streak is at most so thick."""

LENGTH = 10
"""px; a streak is at least so long."""

IMAGE_STEP = 10
"""grey levels (0..255) of any channel; a larger change from one row to the next is an edge that explains the layer."""


def streak_share(disparity: NDArray[np.floating], image: Image) -> float:
    """Share (%) of the pixels of a disparity map that lie in horizontal streaks; see `streak_mask`."""
    return 100 * float(streak_mask(disparity, image).mean())


def streak_mask(disparity: NDArray[np.floating], image: Image) -> Bool:
    """Where a map has horizontal streaks; bool (H, W).

    Each column falls into layers, cut where the disparity changes by more than DISPARITY_STEP px from one row to the
    next. A layer stands out where it is nearer than both the layer above and the one below, or farther than both. It
    is unexplained where it is at most THICKNESS rows thick and no channel of the image changes by more than IMAGE_STEP
    grey levels at either cut. A streak is a horizontal run of at least LENGTH pixels, all in unexplained layers that
    stand out the same way.

    So slanted planes, steps, vertical structures, whatever the image shows and whatever touches the first or last row
    are no streaks; neither is anything next to a disparity that is not finite.

    disparity: (H, W), px. image: the left image, uint8 or uint16, (H, W) or (H, W, 3).
    ValueError where they do not fit.
    """
    if disparity.ndim != 2 or disparity.size == 0 or image.shape[:2] != disparity.shape:
        raise ValueError(f'disparity {disparity.shape} and image {image.shape} must have the same height and width')
    sides = _unexplained_layers(disparity, _has_edge(image))
    return _long_runs(sides > 0) | _long_runs(sides < 0)


def _has_edge(image: Image) -> Bool:
    """bool (H-1, W): whether the image changes much from this row to the next."""
    one_level = 257 if image.dtype == np.uint16 else 1
    change = np.abs(np.diff(image.astype(np.int32), axis=0))
    strongest = change if change.ndim == 2 else change.max(axis=2)
    return np.asarray(strongest > IMAGE_STEP * one_level)


def _unexplained_layers(disparity: NDArray[np.floating], edge: Bool) -> NDArray[np.int8]:
    """int8 (H, W): 1 in unexplained layers nearer than what is above and below, -1 in farther ones, else 0."""
    known = np.where(np.isfinite(disparity), disparity, np.nan)
    step = np.diff(known, axis=0).T  # by columns, so that the cuts of a column follow each other
    cut = ~(np.abs(step) <= DISPARITY_STEP)
    column, row = np.nonzero(cut)
    way, plain = np.sign(step[cut]), ~edge.T[cut]
    layer = column[:-1] == column[1:]
    layer &= np.diff(row) <= THICKNESS
    layer &= way[:-1] * way[1:] < 0
    layer &= plain[:-1] & plain[1:]
    side = way[:-1][layer].astype(np.int8)
    fence = np.zeros((disparity.shape[1], disparity.shape[0]), np.int8)
    fence[column[:-1][layer], row[:-1][layer] + 1] += side
    fence[column[1:][layer], row[1:][layer] + 1] -= side
    return np.cumsum(fence, axis=1, dtype=np.int8).T


def _long_runs(mask: Bool) -> Bool:
    """The part of a mask (H, W) that lies in horizontal runs of at least LENGTH px."""
    padded = np.pad(mask, ((0, 0), (1, 1))).astype(np.int8)
    change = np.diff(padded, axis=1)
    row, start = np.nonzero(change > 0)
    end = np.nonzero(change < 0)[1]
    long = end - start >= LENGTH
    fence = np.zeros(change.shape, np.int8)
    fence[row[long], start[long]] = 1
    fence[row[long], end[long]] = -1
    return np.cumsum(fence, axis=1, dtype=np.int8)[:, :-1] > 0
