"""Raw images to rectified ones by their camera_info (REP 104; binning and roi as image_geometry has them)."""
from __future__ import annotations

import dataclasses
import math
import re
from typing import TYPE_CHECKING, NamedTuple, cast

import cv2
import numpy as np
from numpy.typing import NDArray

from svdm_core.shown import cut, shown

from .stereo_calibration import is_rotation

if TYPE_CHECKING:
    from sensor_msgs.msg import CameraInfo

    Matrix = NDArray[np.float64]
    Pixels = NDArray[np.uint8] | NDArray[np.uint16]

_COEFFICIENTS = {'plumb_bob': (0, 4, 5), 'rational_polynomial': (8, 12, 14), 'equidistant': (4,)}
"""How many numbers D may have, by the distortion model."""
_LARGEST = 1e12
_LARGEST_SIDE = 2**15 - 2
"""px; the maps hold coordinates in 16 bits, and one pixel more on either side."""
_IDENTITY_ERROR = 1e-6
_OFF_PATTERN = 1e-6
"""Largest skew of K and P, in focal lengths."""
_RECTIFIED_NAME = re.compile('(?<!un)(?<!di)rect', re.IGNORECASE)
"""In a part of a topic's name: image_rect, rectified; neither unrectified nor direct."""


class _Window(NamedTuple):
    """Which part of the sensor the image is: x, y, width, height (sensor px), then binned by (x, y)."""

    x: int
    y: int
    width: int
    height: int
    binning_x: int
    binning_y: int


class Calibration(NamedTuple):
    """All that the maps of a raw camera depend on, as values that compare equal where the maps are equal."""

    size: tuple[int, int]
    sensor: tuple[int, int]
    window: _Window
    model: str
    d: tuple[float, ...]
    k: tuple[float, ...]
    r: tuple[float, ...]
    p: tuple[float, ...]


@dataclasses.dataclass(frozen=True, slots=True, eq=False)
class Rectification:
    """Rectifies the images of one camera.

    maps: for each rectified pixel the raw one it is taken from, in OpenCV's fixed-point form: whole px (H, W, 2) int16
    in the order x, y, and the index of the 32nds of a px (H, W) uint16, which is 32 y + x.
    """

    maps: tuple[NDArray[np.int16], NDArray[np.uint16]]

    @classmethod
    def of(cls, info: CameraInfo, width: int, height: int) -> Rectification:
        """The rectification of raw images of `width` x `height` px with a sensor_msgs/CameraInfo of any library.

        K and P belong to the full sensor, of which the image is the binned part `roi`; the rectified image has the size
        of the raw one. A camera_info of 0x0 px fits any image.
        Distortion models: plumb_bob (or empty; 0, 4 or 5 numbers), rational_polynomial (8, 12, 14), equidistant (4).
        Raises ValueError, in one line, for what is no calibration, another model, or an image of another size.
        """
        return cls(_maps(_checked(calibration_of(info, width, height))))

    def __call__(self, pixels: Pixels) -> Pixels:
        """The rectified image of (H, W) or (H, W, 3) uint8 or uint16, interpolated linearly; 0 outside the raw image.

        Raises ValueError where the image has not the size that the maps are for.
        """
        told, found = self.maps[0].shape[:2], pixels.shape[:2]
        if told != found:
            raise ValueError(f'the maps are for images of {told[1]}x{told[0]} px, the image has {found[1]}x{found[0]}: '
                             'make the rectification from its own size')
        rectified = cv2.remap(np.ascontiguousarray(pixels), *self.maps, cv2.INTER_LINEAR)
        return cast('Pixels', rectified)


class RectificationCache:
    """The rectification of one camera, made anew when anything of its calibration changes. Not for several threads."""

    def __init__(self) -> None:
        self._calibration: Calibration | None = None
        self._rectification: Rectification | None = None

    def of(self, info: CameraInfo, width: int, height: int) -> Rectification:
        """As `Rectification.of`; the very object of the last call where all values are the same."""
        calibration = calibration_of(info, width, height)
        if self._rectification is None or calibration != self._calibration:
            self._rectification = Rectification(_maps(_checked(calibration)))
            self._calibration = calibration
        return self._rectification


_COEFFICIENTS_SHOWN = 14


def unrectified_line(info: CameraInfo, topic: str) -> str:
    """One line for images that are matched as rectified but look raw; empty where nothing speaks against them.

    They look raw where D or R of the camera_info tells of something to rectify and no part of the topic's name holds
    `rect`: rectified images come with the camera_info of the raw ones.
    """
    r = _floats(info.r)
    found = []
    if len(info.d) and np.any(np.asarray(info.d) != 0):
        found.append(f'D is [{cut(", ".join(f"{value:g}" for value in info.d[:_COEFFICIENTS_SHOWN]))}]')
    if any(r) and not np.allclose(r, np.eye(3).ravel(), rtol=0, atol=_IDENTITY_ERROR):
        found.append('R is not the identity')
    if not found or _RECTIFIED_NAME.search(topic):
        return ''
    return (f'{cut(topic)} looks raw, its camera_info has something to rectify: {" and ".join(found)}; rectified '
            'images are expected: set `input: raw`, or remap to image_rect')


def calibration_of(info: CameraInfo, width: int, height: int) -> Calibration:
    """What a camera_info says of images of this size, px; nothing is checked."""
    roi = info.roi
    window = _Window(int(roi.x_offset), int(roi.y_offset), int(roi.width or info.width),
                     int(roi.height or info.height), max(int(info.binning_x), 1), max(int(info.binning_y), 1))
    return Calibration(
        (width, height), (int(info.width), int(info.height)), window, info.distortion_model or 'plumb_bob',
        *(_floats(values) for values in (info.d, info.k, info.r, info.p)))


def _floats(values: object) -> tuple[float, ...]:
    """Those that are not a number are one and the same object, which tuples take for equal."""
    numbers: list[float] = np.asarray(values, np.float64).ravel().tolist()
    return tuple(math.nan if math.isnan(number) else number for number in numbers)


# What is refused


def _checked(calibration: Calibration) -> Calibration:
    _check_size(calibration)
    for name, values in (('K', calibration.k), ('D', calibration.d), ('R', calibration.r), ('P', calibration.p)):
        for index, value in enumerate(values):
            if not abs(value) < _LARGEST:
                raise ValueError(f'camera_info has {name}[{index}] = {value:g}, it must be a number below '
                                 f'{_LARGEST:g}: calibrate anew')
    _check_projection('K', np.reshape(calibration.k, (3, 3)))
    _check_model(calibration)
    _check_rotation(np.reshape(calibration.r, (3, 3)))
    _check_projection('P', np.reshape(calibration.p, (3, 4))[:, :3])
    return calibration


def _check_size(calibration: Calibration) -> None:
    width, height = calibration.size
    if not (0 < width <= _LARGEST_SIDE and 0 < height <= _LARGEST_SIDE):
        raise ValueError(f'the image has {width}x{height} px, each side must be 1 to {_LARGEST_SIDE} px: give another')
    if calibration.sensor == (0, 0):
        return
    x, y, part_width, part_height, binning_x, binning_y = calibration.window
    if x + part_width > calibration.sensor[0] or y + part_height > calibration.sensor[1]:
        raise ValueError(f'camera_info has a roi of {part_width}x{part_height} px at ({x}, {y}), it must lie within '
                         f'the {calibration.sensor[0]}x{calibration.sensor[1]} px it tells of: correct the roi')
    expected = part_width // binning_x, part_height // binning_y
    if expected != calibration.size:
        raise ValueError(f'camera_info tells of images of {expected[0]}x{expected[1]} px, after roi and binning, the '
                         f'image has {width}x{height}: publish the camera_info that belongs to the image')


def _check_projection(name: str, matrix: Matrix) -> None:
    """K, or the left part of P: f_x 0 c_x, 0 f_y c_y, 0 0 1."""
    columns = 3 if name == 'K' else 4
    for row in (0, 1):
        if matrix[row, row] <= 0:
            raise ValueError(f'camera_info is not calibrated: {name}[{row * columns + row}] is {matrix[row, row]:g}, '
                             'it must be positive: calibrate the camera, or have its driver publish the calibration')
    expected = matrix.copy()
    expected[0, 1] = expected[1, 0] = 0
    expected[2] = 0, 0, 1
    tolerance = _OFF_PATTERN * np.array([[matrix[0, 0]], [matrix[1, 1]], [1.0]])
    for row, column in np.argwhere(np.abs(matrix - expected) > tolerance):
        raise ValueError(f'camera_info has {name}[{row * columns + column}] = {matrix[row, column]:g}, it must be '
                         f'{expected[row, column]:g}: calibrate anew')


def _check_model(calibration: Calibration) -> None:
    allowed = _COEFFICIENTS.get(calibration.model)
    if allowed is None:
        raise ValueError(f'camera_info has distortion_model {shown(calibration.model)}, it must be '
                         f'{", ".join(_COEFFICIENTS)}: rectify with the tool it was calibrated with, or calibrate anew')
    if len(calibration.d) not in allowed:
        raise ValueError(f'camera_info has {len(calibration.d)} numbers in D, {calibration.model} has '
                         f'{" or ".join(map(str, allowed))}: correct distortion_model or D')


def _check_rotation(r: Matrix) -> None:
    if not is_rotation(r):
        values = ', '.join(f'{value:g}' for value in r.ravel())
        raise ValueError(f'camera_info has R = [{values}], it must be a rotation matrix: calibrate anew, or set R to '
                         'the identity for a camera that is not turned')


# The maps


def _maps(calibration: Calibration) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    k = _of_window(np.reshape(calibration.k, (3, 3)), calibration.window)
    p = _of_window(np.reshape(calibration.p, (3, 4))[:, :3], calibration.window)
    # k3 of four coefficients is 0, as OpenCV has it too; said here as it is what CameraInfo means.
    d = np.array([*calibration.d, 0.0] if calibration.model == 'plumb_bob' and len(calibration.d) == 4
                 else calibration.d)
    r = np.reshape(calibration.r, (3, 3))
    make = cv2.fisheye.initUndistortRectifyMap if calibration.model == 'equidistant' else cv2.initUndistortRectifyMap
    across, down = make(k, d, r, p, calibration.size, cv2.CV_32FC1)
    # By way of floats: convertMaps takes what is far outside, or NaN, to the end of 16 bits and not around it.
    whole, fraction = cv2.convertMaps(across, down, cv2.CV_16SC2)
    return np.asarray(whole, np.int16), np.asarray(fraction, np.uint16)


def _of_window(matrix: Matrix, window: _Window) -> Matrix:
    """K or the left part of P in px of the image, from px of the sensor."""
    zoom = np.diag([1 / window.binning_x, 1 / window.binning_y, 1.0])
    shift = np.array([[1.0, 0.0, -window.x], [0.0, 1.0, -window.y], [0.0, 0.0, 1.0]])
    moved: Matrix = zoom @ shift @ matrix
    return moved
