"""Calibration of a stereo pair: its matrices, scaling to the images as they are, and rectification."""
from __future__ import annotations

import dataclasses
from typing import Literal

import cv2
import numpy as np
from numpy.typing import NDArray

Matrix = NDArray[np.float64]
Size = tuple[int, int]
SideName = Literal['left', 'right']

LARGEST_NUMBER = 1e12
"""Of all in a calibration; beyond, products of matrices overflow."""
LARGEST_SIDE = 2**16
"""px"""
_SMALLEST_FOCAL_LENGTH = 1e-6
"""px"""
_ROTATION_ERROR = 1e-3
"""Largest error of an entry of R times its transpose: calibration files are rounded."""
_SMALLEST_BASELINE = 1e-6
"""m; below it there is nothing to triangulate with."""
_LARGEST_SKEW = 1e-3
"""Largest share of the baseline that may point elsewhere than along the rows of rectified images."""


@dataclasses.dataclass(frozen=True, slots=True)
class CameraCalibration:
    """What `sensor_msgs/CameraInfo` tells of one camera.

    size: width and height (px) of the images it was made for; None where the file does not say.
    k: intrinsics (3, 3), px; d: distortion in OpenCV's order (5,), (8,), (12,) or (14,); r: rotation into the
    rectified camera (3, 3); p: projection of the rectified camera (3, 4), px, with P[0, 3] = -f times baseline (m) on
    the right.
    """

    size: Size | None
    k: Matrix
    d: Matrix
    r: Matrix
    p: Matrix

    def scaled(self, size: Size) -> CameraCalibration:
        """The same camera with images of `size`. ValueError where they are no scaled copy of those calibrated."""
        if self.size is None or self.size == size:
            return dataclasses.replace(self, size=size)
        scale = size[0] / self.size[0]
        if abs(self.size[1] * scale - size[1]) > 1 + scale:  # rounding of either size
            raise ValueError(f'the calibration is of {self.size[0]}x{self.size[1]} px, the images have '
                             f'{size[0]}x{size[1]}, which is no scaled copy of it: give the calibration of them')
        zoom = np.diag([scale, scale, 1.0])
        return dataclasses.replace(self, size=size, k=zoom @ self.k, p=zoom @ self.p)


def is_rotation(r: Matrix) -> bool:
    """Whether (3, 3) is a rotation matrix, rounded as in a file."""
    return bool(np.abs(r @ r.T - np.eye(3)).max() <= _ROTATION_ERROR and np.linalg.det(r) > 0)


def rectified_camera(size: Size | None, p: Matrix) -> CameraCalibration:
    """A camera whose images are rectified already: no distortion, no rotation, K is the left part of P."""
    return CameraCalibration(size, p[:, :3].copy(), np.zeros(5), np.eye(3), p)


@dataclasses.dataclass(frozen=True, slots=True)
class StereoCalibration:
    """Two cameras, the left one the origin: P_left[0, 3] is 0. `source` names the kind of file, for messages.

    Raises ValueError where no baseline along the rows follows from the right P.
    """

    left: CameraCalibration
    right: CameraCalibration
    source: str
    is_rectified: bool

    def __post_init__(self) -> None:
        for side, camera in (('left', self.left), ('right', self.right)):
            if not all(np.isfinite(matrix).all() for matrix in (camera.k, camera.d, camera.r, camera.p)):
                raise ValueError(f'the {side} camera has NaN or infinity in its matrices: calibrate anew')
            if camera.p[0, 0] < _SMALLEST_FOCAL_LENGTH:
                raise ValueError(f'the {side} camera has a focal length of {camera.p[0, 0]:g} px, it must be positive')
        if self.baseline < _SMALLEST_BASELINE:
            raise ValueError(f'the baseline is {self.baseline:g} m, it must be positive: left and right look swapped, '
                             'or the file is of one camera')
        if abs(self.right.p[1, 3]) > _LARGEST_SKEW * abs(self.right.p[0, 3]):
            raise ValueError('the cameras are not side by side: the right P matrix has '
                             f'P[7] = {self.right.p[1, 3]:g} beside P[3] = {self.right.p[0, 3]:g}')

    @property
    def focal_length(self) -> float:
        """px, of the rectified images."""
        return float(self.right.p[0, 0])

    @property
    def baseline(self) -> float:
        """m."""
        return float(-self.right.p[0, 3] / self.right.p[0, 0])

    @property
    def principal_offset(self) -> float:
        """cx_left - cx_right of the rectified images, px."""
        return float(self.left.p[0, 2] - self.right.p[0, 2])

    def scaled(self, size: Size) -> StereoCalibration:
        """The same cameras with images of `size`; ValueError as `CameraCalibration.scaled`."""
        return dataclasses.replace(self, left=self.left.scaled(size), right=self.right.scaled(size))

    def camera(self, side: SideName) -> CameraCalibration:
        """The camera of one side."""
        return self.left if side == 'left' else self.right


class Rectifier:
    """Turns images of one camera, of the size of its calibration, into rectified ones (linear interpolation)."""

    def __init__(self, camera: CameraCalibration) -> None:
        if camera.size is None:
            raise ValueError('a camera without an image size cannot be rectified')
        self._maps = cv2.initUndistortRectifyMap(
            camera.k, camera.d, camera.r, camera.p[:, :3], camera.size, cv2.CV_16SC2)

    def __call__[Pixel: np.uint8 | np.uint16](self, image: NDArray[Pixel]) -> NDArray[Pixel]:
        """The rectified image, of the same shape and dtype; what the camera did not see is 0."""
        return np.asarray(cv2.remap(image, *self._maps, cv2.INTER_LINEAR), image.dtype)


def stereo_rectified(
    size: Size, k: tuple[Matrix, Matrix], d: tuple[Matrix, Matrix], right_from_left: Matrix, source: str
) -> StereoCalibration:
    """R and P of two raw cameras by OpenCV's stereoRectify, with equal principal points and only pixels both have.

    k, d: of the left and the right camera; right_from_left: (4, 4), points of the left camera to the right one, m.
    """
    try:
        r_left, r_right, p_left, p_right, *_ = cv2.stereoRectify(
            k[0], d[0], k[1], d[1], size, right_from_left[:3, :3].copy(), right_from_left[:3, 3:].copy(),
            flags=cv2.CALIB_ZERO_DISPARITY, alpha=0)
    except cv2.error as error:
        raise ValueError('the cameras cannot be rectified, their matrices are no calibration '
                         f'({" ".join(str(error).split())})') from None
    left, right = (CameraCalibration(size, k[side], d[side], np.asarray(r, np.float64), np.asarray(p, np.float64))
                   for side, r, p in ((0, r_left, p_left), (1, r_right, p_right)))
    return StereoCalibration(left, right, source, is_rectified=False)
