"""Disparities in colours, for the eye."""
from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray

from svdm_core.files.colour_maps import DISPARITY_COLOURS


def coloured(disparity: NDArray[np.float32], low: float, high: float) -> NDArray[np.uint8]:
    """uint8 BGR (H, W, 3): blue is `low`, the smallest disparity of the search range, red `high`; black is below."""
    scale = 255 / max(high - low, 1e-9)
    share = cv2.convertScaleAbs(disparity, alpha=scale, beta=-scale * low)  # what is below low is made black
    picture = np.asarray(cv2.applyColorMap(share, DISPARITY_COLOURS), np.uint8)
    picture[disparity < low] = 0
    return picture
