"""Stage 4: the left-right check (eq 15)."""
from __future__ import annotations

import numba
import numpy as np

from ..kernels.arrays import Bool, Int32
from ..kernels.compilation import kernel


def left_right_check(
    left: Int32, right: Int32, min_disparity: int, tau_lr: float
) -> Bool:
    """Where the views agree (eq 15): |d_L(p) - d_R(p - d_L(p))| <= tau_lr, with p - d_L(p) inside the image.

    left, right: int32 (H, W), disparity - min_disparity of either view, the right one mirrored. tau_lr in px.
    """
    return _left_right_check(left, right, min_disparity, tau_lr)


@kernel(parallel=True)
def _left_right_check(left: Int32, right: Int32, min_disparity: int, tau_lr: float) -> Bool:
    height, width = left.shape
    valid = np.empty((height, width), np.bool_)
    for y in numba.prange(height):
        for x in range(width):
            partner = x - left[y, x] - min_disparity
            valid[y, x] = partner >= 0 and abs(left[y, x] - right[y, width - 1 - partner]) <= tau_lr
    return valid
