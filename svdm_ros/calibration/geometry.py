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
_ASPECT_DIFFERS = 0.01
"""Largest relative difference of fx and fy of a rectified camera."""
_ROWS_DIFFER = 0.5
"""px; largest difference of the cy of a rectified pair, whose rows are the same."""
_NO_SHIFT = 1e-6
"""P[3] over P[0], in the unit of the baseline, up to which the left camera is the origin."""
_LONGEST_BASELINE = 10.0
"""m; a longer one is taken for one in cm or mm."""
_NO_SKEW = 1e-6
"""P[1] over P[0], up to which P is that of a rectified camera."""


@dataclasses.dataclass(frozen=True, slots=True)
class StereoGeometry:
    """What turns a disparity into a depth: Z = focal_length * baseline / (d - principal_offset).

    focal_length, focal_length_y: px of the image matched; 0 where unknown.
    baseline: in the unit of the P matrix, m as a rule; 0 where unknown.
    principal_offset: cx_left - cx_right, px of the image matched.
    cx, cy: principal point of the left image, px of the image matched.
    problem: what is missing or contradictory, and what to do about it; empty where all is well.
    """

    focal_length: float = 0.0
    baseline: float = 0.0
    principal_offset: float = 0.0
    problem: str = ''
    focal_length_y: float = 0.0
    cx: float = 0.0
    cy: float = 0.0

    def cropped(self, x: int, y: int) -> StereoGeometry:
        """Of the part of both images that begins at pixel (x, y)."""
        return dataclasses.replace(self, cx=self.cx - x, cy=self.cy - y)

    def shrunk(self, factor: int) -> StereoGeometry:
        """Of the images shrunk by a factor; pixel centres are whole numbers before and after."""
        return dataclasses.replace(
            self, focal_length=self.focal_length / factor, focal_length_y=self.focal_length_y / factor,
            principal_offset=self.principal_offset / factor,
            cx=(self.cx + 0.5) / factor - 0.5, cy=(self.cy + 0.5) / factor - 0.5)


@dataclasses.dataclass(frozen=True, slots=True)
class _Projection:
    """What a rectified P matrix tells, in px of the image as it is."""

    focal_length: float
    cx: float
    tx: float
    focal_length_y: float
    cy: float


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
        problem = f'no {" and no ".join(missing)} received: publish or remap it'
        if baseline > 0:
            problem += f'; the parameter baseline = {baseline:g} m is not enough, as camera_info has the focal length'
        return StereoGeometry(problem=problem)
    try:
        left_projection = _projection(left, 'left', width, height)
        right_projection = _projection(right, 'right', width, height)
        offset = _principal_offset(left_projection, right_projection, width)
    except ValueError as error:
        return StereoGeometry(problem=str(error))
    from_infos = (left_projection.tx - right_projection.tx) / right_projection.focal_length
    used = baseline if baseline > 0 else from_infos
    problems = (
        '' if baseline > 0 else _baseline_problem(left, right, used),
        _focal_length_problem(left_projection, right_projection),
        _rows_problem(left_projection, right_projection),
        *(_shape_problem(info, side) for info, side in ((left, 'left'), (right, 'right'))),
    )
    return StereoGeometry(
        focal_length=right_projection.focal_length,
        baseline=used if used > 0 else 0.0,
        principal_offset=offset,
        problem='; '.join(filter(None, problems)),
        focal_length_y=left_projection.focal_length_y,
        cx=left_projection.cx,
        cy=left_projection.cy,
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


def _rows_problem(left: _Projection, right: _Projection) -> str:
    if abs(left.cy - right.cy) <= _ROWS_DIFFER:
        return ''
    return (
        f'left/camera_info and right/camera_info have cy of {left.cy:g} and {right.cy:g} px, so their rows are not the '
        'same: rectify both images together'
    )


def _shape_problem(info: CameraInfo, side: str) -> str:
    """What makes a P matrix one of no rectified camera."""
    fx, skew, fy = (float(info.p[index]) for index in (0, 1, 5))
    if abs(skew) > _NO_SKEW * fx:
        return f'{side}/camera_info has P[1] = {skew:g}, it must be 0: no rectified image has such a P, calibrate anew'
    if abs(fx - fy) > _ASPECT_DIFFERS * fx:
        return (f'{side}/camera_info has P[0] = {fx:g} and P[5] = {fy:g}, they must be the same: rectify to square '
                'pixels')
    return ''


def _baseline_problem(left: CameraInfo, right: CameraInfo, baseline: float) -> str:
    if baseline > _LONGEST_BASELINE:
        return (
            f'the baseline is {baseline:g} m, more than {_LONGEST_BASELINE:g}: camera_info looks calibrated in cm or '
            'mm: calibrate in m, or set the parameter baseline (m)'
        )
    if baseline > 0:
        if abs(left.p[3]) <= _NO_SHIFT * left.p[0]:
            return ''
        return (
            f'left/camera_info has P[3] = {left.p[3]:g}, so the left camera is not the origin of the pair: the '
            f'baseline {baseline:g} m is the distance of both; set the parameter baseline (m) where it is another'
        )
    found = f'right/camera_info has no baseline: P[3] is {right.p[3]:g}, it must be negative'
    if right.p[3] > 0 or left.p[3] != 0:
        return f'{found}; left and right look swapped: swap the topics, or set the parameter baseline (m)'
    return f'{found}; calibrate the two cameras as a stereo pair, or set the parameter baseline (m)'


def _projection(info: CameraInfo, side: str, width: int, height: int) -> _Projection:
    focal_length, cx, tx, focal_length_y, cy = (float(info.p[index]) for index in (0, 2, 3, 5, 6))
    if not all(abs(value) < _LARGEST for value in (focal_length, cx, tx, focal_length_y, cy)):
        raise ValueError(f'{side}/camera_info has a P matrix with NaN, infinity or beyond {_LARGEST:g}: calibrate anew')
    if focal_length < _SMALLEST_FOCAL_LENGTH:
        raise ValueError(f'{side}/camera_info is not calibrated: P[0] is {focal_length:g}, it must be positive')
    scale = _scale(info, side, width, height)
    down = scale * max(int(info.binning_x), 1) / max(int(info.binning_y), 1)
    return _Projection(focal_length * scale, (cx - info.roi.x_offset) * scale, tx * scale, focal_length_y * down,
                       (cy - info.roi.y_offset) * down)


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
