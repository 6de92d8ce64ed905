"""Cameras that give one image of both views side by side: its halves, and the camera_info of a half."""
from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from sensor_msgs.msg import CameraInfo


def halves[Value: np.generic](pixels: NDArray[Value]) -> tuple[NDArray[Value], NDArray[Value]]:
    """The left and the right half of an image (H, W) or (H, W, channels), as views (H, W / 2[, channels]).

    Raises ValueError where W is odd or 0.
    """
    height, width = pixels.shape[:2]
    if width % 2 or width == 0:
        raise ValueError(f'the image of both views has {width}x{height} px, its width must be even: give one '
                         'that holds the left and the right view, equally wide')
    return pixels[:, :width // 2], pixels[:, width // 2:]


def half_info(info: CameraInfo, side: Literal['left', 'right'], width: int, height: int) -> CameraInfo:
    """The camera_info of one half of an image of `width` x `height` px that holds both views.

    Where `info` tells of the whole image, or a scaled copy of it, a copy with half the width; c_x of the right half (K
    and P) is counted from the half's own left edge. Any other `info` comes back as it is: it tells of the half already,
    or of nothing.
    Raises ValueError where it tells of the whole image and has a roi other than all of it, or a c_x outside the half.
    """
    if not _tells_of(info, width, height):
        return info
    roi, half = info.roi, info.width // 2
    if roi.x_offset or roi.y_offset or roi.width not in (0, info.width) or roi.height not in (0, info.height):
        raise ValueError(f'camera_info has a roi of {roi.width}x{roi.height} px at ({roi.x_offset}, {roi.y_offset}) in '
                         'an image of both views, it must be the whole image or 0: correct the roi')
    def own_part(centre: float) -> float:
        return centre - half if side == 'right' and centre >= half else centre

    if not 0 <= own_part(_centre(info)) < half:
        raise ValueError(f'camera_info of the {side} half has c_x = {_centre(info):g} px, it must be within the half, '
                         f'which is {half} px wide: give the calibration of each half')
    own = copy.deepcopy(info)
    own.width = half
    if roi.width:
        own.roi.width = half
    own.k[2], own.p[2] = own_part(float(own.k[2])), own_part(float(own.p[2]))
    return own


def _tells_of(info: CameraInfo, width: int, height: int) -> bool:
    """Whether the image is a copy, scaled by binning or otherwise, of what camera_info tells of."""
    told_width, told_height = info.width // max(info.binning_x, 1), info.height // max(info.binning_y, 1)
    if told_width == 0 or told_height == 0:
        return False
    scale = width / told_width
    return bool(abs(told_height * scale - height) <= 1 + scale)  # rounding of either side


def _centre(info: CameraInfo) -> float:
    """c_x, px: of K, or of P where K is not set."""
    return float(info.k[2] if info.k[0] else info.p[2])
