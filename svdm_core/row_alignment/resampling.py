"""Resampling an image along its columns by a fixed map."""
from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from ..kernels.arrays import Float32, Float64, Image


class RowMap(NamedTuple):
    """x, y: float32 (H, W), px: where each pixel is taken from."""

    x: Float32
    y: Float32


def row_map(offsets: Float64) -> RowMap:
    """The map that takes pixel (x, y) from (x, y + offsets[y, x]); offsets: (H, W), px."""
    height, width = offsets.shape
    columns, rows = np.arange(width, dtype=np.float32), np.arange(height, dtype=np.float64)
    return RowMap(np.repeat(columns[None], height, axis=0), (rows[:, None] + offsets).astype(np.float32))


def resampled(image: Image, where: RowMap) -> Image:
    """A new image of the kind of `image` (H, W) or (H, W, 3), cubic; beyond the border it is as at the border."""
    return np.asarray(cv2.remap(image, where.x, where.y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE))
