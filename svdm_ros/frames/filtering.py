"""Which disparities of a matched pair are known: published, and given a depth."""
from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from svdm_core import DisparityResult

    from ..calibration.geometry import StereoGeometry
    from ..node.parameter_set import NodeParameters

_SPECKLE_STEP = 1.0
"""px; neighbours whose disparities differ by more belong to different regions."""

_SUBPIXEL = 16
_UNKNOWN = np.iinfo(np.int16).min


def known_pixels(
    result: DisparityResult, geometry: StereoGeometry, parameters: NodeParameters
) -> NDArray[np.bool_]:
    """bool (H, W): what `publish_filled`, `confidence_threshold`, the depths and `speckle_size` leave."""
    known = result.valid.copy() if not parameters.publish_filled else np.ones(result.valid.shape, np.bool_)
    if parameters.confidence_threshold > 0:
        known &= result.valid  # the confidence is 1 or 0
    distance = np.float32(geometry.focal_length * geometry.baseline)
    if distance > 0:
        shifted = result.disparity - np.float32(geometry.principal_offset)
        if parameters.min_depth > 0:
            known &= shifted * np.float32(parameters.min_depth) <= distance
        if parameters.max_depth > 0:
            known &= shifted * np.float32(parameters.max_depth) >= distance
    if parameters.speckle_size > 0:
        known &= ~speckles(result.disparity, known, parameters.speckle_size)
    return known


def nothing_left(parameters: NodeParameters) -> str:
    """What to look at where no pixel is known."""
    names = [name for name in ('min_depth', 'max_depth', 'speckle_size', 'confidence_threshold')
             if getattr(parameters, name) > 0]
    return (f'no disparity is left in the whole image: look at {", ".join([*names, "num_disparities"])}, and whether '
            'left and right are swapped')


def speckles(disparity: NDArray[np.float32], known: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    """bool (H, W): where connected known pixels, each within 1 px of its neighbour, are `size` or fewer."""
    sixteenths = np.where(known, np.rint(_SUBPIXEL * disparity), _UNKNOWN).astype(np.int16)
    left, _ = cv2.filterSpeckles(sixteenths, float(_UNKNOWN), size, _SUBPIXEL * _SPECKLE_STEP)
    found: NDArray[np.bool_] = known & (np.asarray(left) == _UNKNOWN)
    return found
