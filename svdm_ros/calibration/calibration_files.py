"""Calibration files of KITTI, EuRoC, Middlebury v3 and ROS camera_calibration, told apart by what is in them."""
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ..command_line.user_files import SETTINGS, parse_yaml, read_text, shown
from .stereo_calibration import CameraCalibration, Matrix, Size, StereoCalibration, rectified_camera, stereo_rectified

KINDS = 'calib.txt or calib_cam_to_cam.txt of KITTI, calib.txt of Middlebury v3, sensor.yaml of EuRoC (cam0, cam1), ' \
        'yaml of ROS camera_calibration (left, right)'
COLOUR_FOLDERS = ('image_2', 'image_3', 'image_02', 'image_03')
"""KITTI's folders of the colour cameras, 2 and 3; its grey ones are 0 and 1."""
_OPENCV_HEAD = '%YAML:1.0'
"""OpenCV, and with it EuRoC's tools, write a version line that YAML itself does not know."""
_DIGITS = frozenset('0123456789+-.eE')
_LONGEST_NUMBER = 64
_SEPARATORS = str.maketrans('[],;', '    ')
_LARGEST_SIDE = 2**16
"""px"""
_SAME_OFFSET = 0.01
"""px; doffs of Middlebury is rounded to three places, and so are the principal points."""


def read_calibration(files: Sequence[Path], colour: bool) -> StereoCalibration:
    """The calibration in `files`: one of the pair, or one of each camera, left first.

    colour: of KITTI's two pairs of cameras, take that of the colour images (2 and 3).
    Raises ValueError naming the file, and the key that is missing or wrong.
    """
    if len(files) > 2:
        raise ValueError(f'--calib is given {len(files)} times: once, or twice for a file of each camera, left first')
    if files[0].suffix.lower() in ('.yaml', '.yml'):
        return _read_yaml_pair(files)
    text = _read(files[0])
    try:
        if len(files) == 2:
            raise ValueError('is the calibration of both cameras: give --calib once')
        values = _labelled(text, '=')
        return _middlebury(values) if 'cam0' in values else _kitti(text, colour)
    except ValueError as error:
        raise ValueError(f'{files[0]}: {error}') from None


def _read(path: Path) -> str:
    if not path.exists():
        raise ValueError(f'{path}: there is no such file; --calib takes {KINDS}')
    return read_text(path, SETTINGS)


# Text of names and numbers. Split and counted: a regular expression may try a line in a million ways.


def _labelled(text: str, sign: str) -> dict[str, str]:
    """The lines `name SIGN value`."""
    values = {}
    for line in text.splitlines():
        name, found, value = line.partition(sign)
        if found and name.strip().replace('_', 'a').isalnum():
            values[name.strip()] = value.strip()
    return values


def _numbers(text: str, count: int, name: str, what: str) -> list[float]:
    """All numbers of a text, which are `count`."""
    words = text.translate(_SEPARATORS).split()
    if len(words) != count:
        raise ValueError(f'{name} has {len(words)} numbers, {what} has {count}')
    return [_number(word, f'{name} has') for word in words]


def _number(word: str, told: str) -> float:
    if _looks_like_a_number(word):
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if math.isfinite(value):
            return value
    raise ValueError(f'{told} {shown(word)}, it must be a number')


def _looks_like_a_number(word: str) -> bool:
    return len(word) <= _LONGEST_NUMBER and _DIGITS.issuperset(word)


def _size(width: float, height: float, name: str) -> Size:
    if not all(px.is_integer() and 0 < px <= _LARGEST_SIDE for px in (width, height)):
        raise ValueError(f'{name} is {width:g} x {height:g}, it must be whole px from 1 to {_LARGEST_SIDE}')
    return int(width), int(height)


# Middlebury v3


def _middlebury(values: Mapping[str, str]) -> StereoCalibration:
    left, right = (_middlebury_camera(values, name) for name in ('cam0', 'cam1'))
    baseline, doffs, width, height = (_middlebury_number(values, name)
                                      for name in ('baseline', 'doffs', 'width', 'height'))
    if abs(right[0, 2] - left[0, 2] - doffs) > _SAME_OFFSET:
        raise ValueError(f'doffs is {doffs:g}, the principal points of cam0 and cam1 are '
                         f'{right[0, 2] - left[0, 2]:g} px apart: one of them is wrong')
    size = _size(width, height, 'width, height')
    zero = np.zeros((3, 1))
    p_left, p_right = np.hstack([left, zero]), np.hstack([right, zero])
    p_right[0, 3] = -right[0, 0] * baseline / 1000  # mm
    return StereoCalibration(rectified_camera(size, p_left), rectified_camera(size, p_right), 'Middlebury', True)


def _middlebury_camera(values: Mapping[str, str], name: str) -> Matrix:
    return np.reshape(_numbers(_needed(values, name), 9, name, 'a camera matrix'), (3, 3))


def _middlebury_number(values: Mapping[str, str], name: str) -> float:
    return _number(_needed(values, name), f'{name} is')


# KITTI


def _kitti(text: str, colour: bool) -> StereoCalibration:
    lines = [line for line in text.splitlines() if line.strip()]
    labelled = _labelled(text, ':')
    cameras = (2, 3) if colour else (0, 1)
    if 'P_rect_00' in labelled or 'P_rect_02' in labelled:
        matrices = [_kitti_matrix(labelled, f'P_rect_0{camera}') for camera in cameras]
        size = _kitti_size(labelled, f'S_rect_0{cameras[0]}')
        return _kitti_pair(matrices, size)
    if 'P0' in labelled or 'P2' in labelled:
        return _kitti_pair([_kitti_matrix(labelled, f'P{camera}') for camera in cameras], None)
    if len(lines) in (2, 4) and all(_looks_like_a_number(word) for line in lines for word in line.split()):
        matrices = [_twelve(line, f'line {number}') for number, line in enumerate(lines, 1)]
        first = cameras[0] if len(lines) == 4 else 0
        return _kitti_pair(matrices[first:first + 2], None)
    raise ValueError(f'is none of the calibrations known: {KINDS}')


def _kitti_pair(matrices: Sequence[Matrix], size: Size | None) -> StereoCalibration:
    """KITTI counts from camera 0; here the left camera is the origin. The images are rectified."""
    left, right = (np.hstack([matrix[:, :3], np.zeros((3, 1))]) for matrix in matrices)
    right[0, 3] = matrices[1][0, 3] - matrices[0][0, 3]
    return StereoCalibration(rectified_camera(size, left), rectified_camera(size, right), 'KITTI', True)


def _kitti_matrix(values: Mapping[str, str], name: str) -> Matrix:
    return _twelve(_needed(values, name), name)


def _twelve(text: str, name: str) -> Matrix:
    return np.reshape(_numbers(text, 12, name, 'a projection matrix'), (3, 4))


def _kitti_size(values: Mapping[str, str], name: str) -> Size:
    width, height = _numbers(_needed(values, name), 2, name, 'an image size')
    return _size(width, height, name)


# yaml, a file a camera: EuRoC and ROS camera_calibration


def _read_yaml_pair(files: Sequence[Path]) -> StereoCalibration:
    left = _load_yaml(files[0])
    try:
        if 'T_BS' not in left and 'camera_matrix' not in left:
            raise ValueError(f'is none of the calibrations known, neither T_BS nor camera_matrix is in it: {KINDS}')
        right_file = files[1] if len(files) == 2 else _euroc_sibling(files[0])
    except ValueError as error:
        raise ValueError(f'{files[0]}: {error}') from None
    right = _load_yaml(right_file)
    try:
        return _euroc(left, right) if 'T_BS' in left else _ros(left, right)
    except ValueError as error:
        raise ValueError(f'{files[0]} and {right_file}: {error}') from None


def _load_yaml(path: Path) -> dict[str, Any]:
    text = _read(path)
    if text.startswith(_OPENCV_HEAD):
        text = text.removeprefix(_OPENCV_HEAD).lstrip().removeprefix('---')
    try:
        content = parse_yaml(text, SETTINGS)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None
    if not isinstance(content, dict):
        raise ValueError(f'{path}: no YAML of names and values')
    return content


def _euroc_sibling(left: Path) -> Path:
    """EuRoC's cam1/sensor.yaml for its cam0/sensor.yaml."""
    camera = left.resolve().parent
    sibling = camera.parent / 'cam1' / left.name
    if camera.name != 'cam0' or not sibling.is_file():
        raise ValueError('is the calibration of one camera: give --calib twice, left first')
    return sibling


def _euroc(left: Mapping[str, Any], right: Mapping[str, Any]) -> StereoCalibration:
    """T_BS takes points of the sensor (camera) to the body."""
    cameras = {'left': left, 'right': right}
    sizes = {side: _size_of(_needed(camera, 'resolution'), f'resolution of the {side} camera')
             for side, camera in cameras.items()}
    _check_same_size(sizes)
    k, d, t = [], [], []
    for side, camera in cameras.items():
        _check_model(camera, side, 'distortion_model', ('radial-tangential', 'radtan', 'plumb_bob'))
        f_x, f_y, c_x, c_y = _array(camera, 'intrinsics', (4,), side)
        k.append(np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]))
        d.append(np.append(_array(camera, 'distortion_coefficients', (4,), side), 0.0))
        t.append(_array(camera, 'T_BS', (4, 4), side))
    right_from_left = np.linalg.inv(t[1]) @ t[0]
    return stereo_rectified(sizes['left'], (k[0], k[1]), (d[0], d[1]), right_from_left, 'EuRoC')


def _ros(left: Mapping[str, Any], right: Mapping[str, Any]) -> StereoCalibration:
    cameras = {'left': left, 'right': right}
    sizes = {side: _size_of([_needed(camera, 'image_width'), _needed(camera, 'image_height')],
                            f'image_width, image_height of the {side} camera') for side, camera in cameras.items()}
    _check_same_size(sizes)
    read = {side: _ros_camera(camera, side, sizes[side]) for side, camera in cameras.items()}
    return StereoCalibration(read['left'], read['right'], 'ROS', is_rectified=False)


def _ros_camera(camera: Mapping[str, Any], side: str, size: Size) -> CameraCalibration:
    _check_model(camera, side, 'distortion_model', ('plumb_bob', 'rational_polynomial'))
    length = 8 if camera['distortion_model'] == 'rational_polynomial' else 5
    return CameraCalibration(
        size, _array(camera, 'camera_matrix', (3, 3), side), _array(camera, 'distortion_coefficients', (length,), side),
        _array(camera, 'rectification_matrix', (3, 3), side), _array(camera, 'projection_matrix', (3, 4), side))


def _check_model(camera: Mapping[str, Any], side: str, name: str, allowed: Sequence[str]) -> None:
    model = _needed(camera, name)
    if model not in allowed:
        raise ValueError(f'{name} of the {side} camera is {shown(model)}, it must be {" or ".join(allowed)}: rectify '
                         'the images with the tool they were calibrated with, and give a calibration of the result')


def _check_same_size(sizes: Mapping[str, Size]) -> None:
    if sizes['left'] != sizes['right']:
        told = ', '.join(f'{side} {width}x{height}' for side, (width, height) in sizes.items())
        raise ValueError(f'the calibrations are of images of different sizes: {told} px')


def _size_of(value: Any, what: str) -> Size:
    if not isinstance(value, list) or len(value) != 2 or not all(
            isinstance(px, int) and 0 < px <= _LARGEST_SIDE for px in value):
        raise ValueError(f'{what} is {shown(value)}, it must be [width, height] in px, up to {_LARGEST_SIDE}')
    return value[0], value[1]


def _array(camera: Mapping[str, Any], name: str, shape: tuple[int, ...], side: str) -> Matrix:
    """A list of numbers, or a matrix as OpenCV writes it: rows, cols, data."""
    value = _needed(camera, name)
    numbers = value.get('data') if isinstance(value, dict) else value
    count = int(np.prod(shape))
    try:
        array = np.array(numbers, np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        array = np.empty(0)
    if array.size != count or not np.isfinite(array).all():
        raise ValueError(f'{name} of the {side} camera must be {count} numbers')
    return array.reshape(shape)


def _needed(values: Mapping[str, Any], name: str) -> Any:
    if name not in values:
        raise ValueError(f'{name} is missing')
    return values[name]
