"""Disparities and errors as colours for the eye."""
from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from ..kernels.arrays import Uint8

DISPARITY_COLOURS = cv2.COLORMAP_TURBO
ERROR_COLOURS = cv2.COLORMAP_INFERNO


def colour_map(
    values: NDArray[np.floating], low: float, high: float, colours: int, unknown: tuple[int, int, int]
) -> Uint8:
    """uint8 BGR (H, W, 3): `low` to `high` over one of OpenCV's colour maps, clipped; `unknown` where not finite.

    values: (H, W).
    """
    known = np.isfinite(values)
    share = np.clip((np.where(known, values, low) - low) / max(high - low, 1e-9), 0, 1)
    picture = np.asarray(cv2.applyColorMap(np.rint(255 * share).astype(np.uint8), colours), np.uint8)
    picture[~known] = unknown
    return picture


def shown_range(values: NDArray[np.floating]) -> tuple[float, float]:
    """Whole numbers around all finite values but the outermost 0.5 % at either end; (0, 1) where none is finite."""
    known = values[np.isfinite(values)]
    if not known.size:
        return 0.0, 1.0
    low, high = np.percentile(known, (0.5, 99.5))
    return float(np.floor(low)), float(max(np.ceil(high), np.floor(low) + 1))
