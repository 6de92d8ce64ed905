"""Stage 4, disparity refinement: left-right check, filling (eqs 15-16), weighted median (eqs 17-19)."""
from __future__ import annotations

import cv2
import numba
import numpy as np

from .arrays import Bool, Float32, Image, Int32
from .matching_cost import intensities
from .parameters import MatcherParameters
from .weighted_median import weighted_median, weighted_median_of_disparity


def left_right_check(
    left: Int32, right: Int32, min_disparity: int, tau_lr: float
) -> Bool:
    """Where the views agree (eq 15): |d_L(p) - d_R(p - d_L(p))| <= tau_lr, with p - d_L(p) inside the image.

    left, right: int32 (H, W), disparity - min_disparity of either view, the right one mirrored. tau_lr in px.
    """
    return _left_right_check(left, right, min_disparity, tau_lr)


def fill_along_scanlines(disparity: Int32, valid: Bool) -> Int32:
    """Give each invalid pixel the smaller of the nearest valid disparities left and right on its row (eq 16).

    With a valid pixel on one side only it takes that side; a row without any keeps what it has.
    disparity: int32 (H, W); valid: bool (H, W). Returns int32 (H, W).
    """
    filled = disparity.copy()
    _fill(filled, valid)
    return filled


def refine(
    winner: Int32,
    vertex: Float32 | None,
    valid: Bool,
    left: Image,
    parameters: MatcherParameters,
) -> Float32:
    """Fill what failed the left-right check and take the weighted median; float32 (H, W), px, dense.

    winner: int32 (H, W), disparity - min_disparity. vertex: float32 (H, W), sub-pixel offset of the winner
    or None. valid: bool (H, W). left: the left image. A valid pixel whose median is its own winner keeps
    its sub-pixel disparity, up to the final median.
    """
    filled = fill_along_scanlines(winner, valid)
    wanted = ~valid if parameters.median_scope == 'filled' else None
    window, sigma_s, sigma_c = parameters.w_p, parameters.sigma_s, parameters.sigma_c
    if parameters.median_guide == 'image':
        median = weighted_median(filled, intensities(left), wanted, window, sigma_s, sigma_c)
    else:
        median = weighted_median_of_disparity(filled, wanted, window, sigma_s, sigma_c, parameters.num_disparities)
    disparity = (median + parameters.min_disparity).astype(np.float32)
    if vertex is not None:
        disparity += np.where(valid & (median == winner), vertex, np.float32(0))
    return disparity if parameters.final_median == 1 else np.asarray(cv2.medianBlur(disparity, parameters.final_median))


@numba.njit(cache=True, parallel=True, nogil=True)
def _left_right_check(left: Int32, right: Int32, min_disparity: int, tau_lr: float) -> Bool:
    height, width = left.shape
    valid = np.empty((height, width), np.bool_)
    for y in numba.prange(height):
        for x in range(width):
            partner = x - left[y, x] - min_disparity
            valid[y, x] = partner >= 0 and abs(left[y, x] - right[y, width - 1 - partner]) <= tau_lr
    return valid


@numba.njit(cache=True, parallel=True, nogil=True)
def _fill(disparity: Int32, valid: Bool) -> None:
    height, width = disparity.shape
    for y in numba.prange(height):
        row, known = disparity[y], valid[y]
        before = np.int32(-1)
        x = 0
        while x < width:
            if known[x]:
                before = row[x]
                x += 1
                continue
            end = x
            while end < width and not known[end]:
                end += 1
            after = row[end] if end < width else before
            value = after if before < 0 else min(before, after)
            if value >= 0:
                row[x:end] = value
            x = end
