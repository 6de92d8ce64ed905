"""Focal length, baseline and principal points of the images as they are, from two camera_info messages."""
from __future__ import annotations

import dataclasses
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from sensor_msgs.msg import CameraInfo

_LARGEST = 1e12
_SMALLEST_FOCAL_LENGTH = 1e-6
_LARGEST_OFFSET = 10
"""Most that the principal points may be apart, in image widths. Far beyond, float32 no longer tells px from px."""
_FOCAL_LENGTHS_DIFFER = 0.01
"""Largest relative difference of the focal lengths of a rectified pair."""
_NO_SHIFT = 1e-6
"""P[3] over P[0], in the unit of the baseline, up to which the left camera is the origin."""


@dataclasses.dataclass(frozen=True, slots=True)
class StereoGeometry:
    """What turns a disparity into a depth: Z = focal_length * baseline / (d - principal_offset).

    focal_length: px of the image matched; 0 where unknown.
    baseline: in the unit of the P matrix, m as a rule; 0 where unknown.
    principal_offset: cx_left - cx_right, px of the image matched.
    problem: what is missing or contradictory, and what to do about it; empty where all is well.
    """

    focal_length: float = 0.0
    baseline: float = 0.0
    principal_offset: float = 0.0
    problem: str = ''


@dataclasses.dataclass(frozen=True, slots=True)
class _Projection:
    """The first row of a rectified P matrix, in px of the image as it is."""

    focal_length: float
    cx: float
    tx: float


def stereo_geometry(
    left: CameraInfo | None, right: CameraInfo | None, width: int, height: int, baseline: float = 0.0
) -> StereoGeometry:
    """Geometry of a pair of rectified images of `width` x `height` px.

    P belongs to the full image, so binning, roi and any further scaling to width x height are applied (REP 104).
    A `baseline` above 0 replaces the one in the right P. Nothing raises: what cannot be known is 0, and `problem`
    says why.
    """
    if left is None or right is None:
        missing = [f'{side}/camera_info' for side, info in (('left', left), ('right', right)) if info is None]
        return StereoGeometry(problem=f'no {" and no ".join(missing)} received: publish or remap it')
    try:
        left_projection = _projection(left, 'left', width, height)
        right_projection = _projection(right, 'right', width, height)
        offset = _principal_offset(left_projection, right_projection, width)
    except ValueError as error:
        return StereoGeometry(problem=str(error))
    from_info = -right_projection.tx / right_projection.focal_length
    used = baseline if baseline > 0 else from_info
    problems = (
        '' if baseline > 0 else _baseline_problem(left, right, used),
        _focal_length_problem(left_projection, right_projection),
    )
    return StereoGeometry(
        focal_length=right_projection.focal_length,
        baseline=used if used > 0 else 0.0,
        principal_offset=offset,
        problem='; '.join(filter(None, problems)),
    )


def _principal_offset(left: _Projection, right: _Projection, width: int) -> float:
    offset = left.cx - right.cx
    if abs(offset) > _LARGEST_OFFSET * width:
        raise ValueError(
            f'left/camera_info and right/camera_info have principal points {offset:g} px apart in images {width} px '
            f'wide, at most {_LARGEST_OFFSET} image widths are possible: calibrate anew'
        )
    return offset


def _focal_length_problem(left: _Projection, right: _Projection) -> str:
    if abs(left.focal_length - right.focal_length) <= _FOCAL_LENGTHS_DIFFER * right.focal_length:
        return ''
    return (
        f'left/camera_info and right/camera_info have focal lengths of {left.focal_length:g} and '
        f'{right.focal_length:g} px: rectify both images to the same one'
    )


def _baseline_problem(left: CameraInfo, right: CameraInfo, baseline: float) -> str:
    if baseline > 0:
        if abs(left.p[3]) <= _NO_SHIFT * left.p[0]:
            return ''
        return (
            f'left/camera_info has P[3] = {left.p[3]:g}, it must be 0, as the baseline is taken from '
            'right/camera_info alone: calibrate the two cameras as a stereo pair, or set the parameter baseline (m)'
        )
    found = f'right/camera_info has no baseline: P[3] is {right.p[3]:g}, it must be negative'
    if right.p[3] > 0 or left.p[3] != 0:
        return f'{found}; left and right look swapped: swap the topics, or set the parameter baseline (m)'
    return f'{found}; calibrate the two cameras as a stereo pair, or set the parameter baseline (m)'


def _projection(info: CameraInfo, side: str, width: int, height: int) -> _Projection:
    focal_length, cx, tx = (float(info.p[index]) for index in (0, 2, 3))
    if not all(abs(value) < _LARGEST for value in (focal_length, cx, tx)):
        raise ValueError(f'{side}/camera_info has a P matrix with NaN, infinity or beyond {_LARGEST:g}: calibrate anew')
    if focal_length < _SMALLEST_FOCAL_LENGTH:
        raise ValueError(f'{side}/camera_info is not calibrated: P[0] is {focal_length:g}, it must be positive')
    scale = _scale(info, side, width, height)
    return _Projection(focal_length * scale, (cx - info.roi.x_offset) * scale, tx * scale)


def _scale(info: CameraInfo, side: str, width: int, height: int) -> float:
    """Pixels of the image per pixel of P; ValueError where the image is no scaled copy of what camera_info tells."""
    full_width: int = info.roi.width or info.width
    full_height: int = info.roi.height or info.height
    binning_x, binning_y = max(int(info.binning_x), 1), max(int(info.binning_y), 1)
    if full_width == 0 or full_height == 0:
        return 1.0 / binning_x  # a driver that leaves the size out
    scale = width / full_width
    # One pixel for rounding in each direction, as binning and resizing cut odd sizes.
    if abs(full_height * scale * binning_x / binning_y - height) > 1 + height / width:
        raise ValueError(
            f'{side}/camera_info tells of {full_width}x{full_height} px, the image has {width}x{height}: '
            'publish the camera_info that belongs to the image'
        )
    return scale
