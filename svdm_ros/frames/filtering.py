"""Which disparities of a matched pair are known: published, and given a depth."""
from __future__ import annotations

from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from ..calibration.geometry import StereoGeometry
    from ..node.parameter_set import NodeParameters
    from .matched_frame import MatchedFrame

_SPECKLE_STEP = 1.0
"""px; neighbours whose disparities differ by more belong to different regions."""

_SUBPIXEL = 16
_UNKNOWN = np.iinfo(np.int16).min

_MOST = 0.5
"""Share of the pixels that are valid, with any confidence, where the match is a good one."""


def filled_or_valid(valid: NDArray[np.bool_], parameters: NodeParameters) -> NDArray[np.bool_]:
    """bool (H, W): every pixel, or without `publish_filled` those of `valid`, bool (H, W)."""
    return np.ones(valid.shape, np.bool_) if parameters.publish_filled else valid


def within_depths(
    disparity: NDArray[np.float32], geometry: StereoGeometry, parameters: NodeParameters
) -> NDArray[np.bool_] | None:
    """bool (H, W): what `min_depth` and `max_depth` leave; None: everything. disparity: px, x_left - x_right."""
    distance = np.float32(geometry.focal_length * geometry.baseline)
    if distance <= 0 or parameters.min_depth == parameters.max_depth == 0:
        return None
    shifted = disparity - np.float32(geometry.principal_offset)
    within = np.ones(disparity.shape, np.bool_)
    if parameters.min_depth > 0:
        within &= shifted * np.float32(parameters.min_depth) <= distance
    if parameters.max_depth > 0:
        within &= shifted * np.float32(parameters.max_depth) >= distance
    return within


def without_speckles(
    disparity: NDArray[np.float32], known: NDArray[np.bool_], parameters: NodeParameters
) -> NDArray[np.bool_]:
    """bool (H, W): what `speckle_size` leaves of `known`."""
    if parameters.speckle_size == 0:
        return known
    return known & ~speckles(disparity, known, parameters.speckle_size)


def nothing_left(frame: MatchedFrame) -> str:
    """What to look at where the parameters leave no pixel, or empty.

    Where the match itself has failed, or there is no texture, few pixels have any confidence: that is not for the
    threshold, and not told here.
    Speckles are not searched for, which takes longer than all the rest: what is no larger than one is nothing.
    """
    parameters = frame.parameters
    if np.count_nonzero(frame.candidates) <= parameters.speckle_size:
        names = [name for name in ('min_depth', 'max_depth', 'speckle_size') if getattr(parameters, name) > 0]
        return (f'no disparity is left in the whole image: look at {", ".join([*names, "num_disparities"])}, and '
                'whether left and right are swapped')
    if (np.count_nonzero(frame.candidates & frame.confident) <= parameters.speckle_size
            and np.count_nonzero(frame.valid & (frame.confidence > 0)) > _MOST * frame.valid.size):
        return (f'no pixel of the whole image reaches confidence_threshold = {parameters.confidence_threshold:g}, so '
                'that none has a depth: lower it')
    return ''


def speckles(disparity: NDArray[np.float32], known: NDArray[np.bool_], size: int) -> NDArray[np.bool_]:
    """bool (H, W): where connected known pixels, each within 1 px of its neighbour, are `size` or fewer."""
    sixteenths = np.where(known, np.rint(_SUBPIXEL * disparity), _UNKNOWN).astype(np.int16)
    left, _ = cv2.filterSpeckles(sixteenths, float(_UNKNOWN), size, _SUBPIXEL * _SPECKLE_STEP)
    found: NDArray[np.bool_] = known & (np.asarray(left) == _UNKNOWN)
    return found
