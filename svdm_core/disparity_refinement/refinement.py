"""Stage 4, disparity refinement: filling (eq 16), weighted median (eqs 17-19), final median."""
from __future__ import annotations

import cv2
import numpy as np

from ..kernels.arrays import Bool, Float32, Image, Int32
from ..matching_cost.planes import intensities
from ..parameters import MatcherParameters
from .filling import fill_along_scanlines
from .weighted_median import weighted_median, weighted_median_of_disparity


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
