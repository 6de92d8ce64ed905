"""Calibrations as YAML: EuRoC and ROS camera_calibration, a file of each camera, and Kalibr, one of both."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from svdm_core.files.user_files import SETTINGS, parse_yaml
from svdm_core.shown import shown

from .stereo_calibration import (
    LARGEST_NUMBER,
    LARGEST_SIDE,
    CameraCalibration,
    Matrix,
    Size,
    StereoCalibration,
    is_rotation,
    stereo_rectified,
)
from .text_calibrations import needed

_OPENCV_HEAD = '%YAML:1.0'
"""OpenCV, and with it EuRoC's tools, write a version line that YAML itself does not know."""
_RADTAN = ('radial-tangential', 'radtan', 'plumb_bob')
"""Names of one model: k1, k2, p1, p2, and k3, which is 0 where there are four."""
_COEFFICIENTS = {**dict.fromkeys(_RADTAN, (4, 5)), 'rational_polynomial': (8, 12, 14), '': (4, 5, 8, 12, 14)}
"""How many a model may have; '': none is named, as older tools write it, and their number tells."""


def load_yaml(text: str) -> dict[str, Any]:
    """What is in a YAML file, or one that OpenCV wrote. Raises ValueError where it has no names and values."""
    if text.startswith(_OPENCV_HEAD):
        text = text.removeprefix(_OPENCV_HEAD).lstrip().removeprefix('---')
    content = parse_yaml(text, SETTINGS)
    if not isinstance(content, dict):
        raise ValueError('no YAML of names and values')
    return content


def is_kalibr(content: Mapping[str, Any]) -> bool:
    """Whether it is a camchain of Kalibr, which holds all cameras."""
    return isinstance(content.get('cam0'), dict)


def is_camera(content: Mapping[str, Any]) -> bool:
    """Whether it is the calibration of one camera."""
    return 'T_BS' in content or 'camera_matrix' in content


def right_file_of(left: Path) -> Path:
    """EuRoC's cam1/sensor.yaml for its cam0/sensor.yaml. Raises ValueError where there is none."""
    camera = left.resolve().parent
    sibling = camera.parent / 'cam1' / left.name
    if camera.name != 'cam0' or not sibling.is_file():
        raise ValueError('is the calibration of one camera: give --calib twice, left first')
    return sibling


def kalibr(chain: Mapping[str, Any]) -> StereoCalibration:
    """Of a camchain; T_cn_cnm1 takes points of cam0 to cam1. Raises ValueError naming what is wrong."""
    left, right = (_kalibr_camera(chain, name) for name in ('cam0', 'cam1'))
    return _raw_pair(left, right, _transform(right, 'T_cn_cnm1', 'right'), 'Kalibr')


def euroc(left: Mapping[str, Any], right: Mapping[str, Any]) -> StereoCalibration:
    """T_BS takes points of the sensor (camera) to the body. Raises ValueError naming what is wrong."""
    body_from_left, body_from_right = (_transform(camera, 'T_BS', side)
                                       for side, camera in (('left', left), ('right', right)))
    return _raw_pair(left, right, np.linalg.inv(body_from_right) @ body_from_left, 'EuRoC')


def ros(left: Mapping[str, Any], right: Mapping[str, Any]) -> StereoCalibration:
    """Of ROS camera_calibration. Raises ValueError naming what is wrong."""
    cameras = {'left': left, 'right': right}
    sizes = {side: _size_of([needed(camera, 'image_width'), needed(camera, 'image_height')],
                            f'image_width, image_height of the {side} camera') for side, camera in cameras.items()}
    _check_same_size(sizes)
    read = {side: _ros_camera(camera, side, sizes[side]) for side, camera in cameras.items()}
    return StereoCalibration(read['left'], read['right'], 'ROS', is_rectified=False)


def _kalibr_camera(chain: Mapping[str, Any], name: str) -> dict[str, Any]:
    camera = needed(chain, name)
    if not isinstance(camera, dict):
        raise ValueError(f'{name} is {shown(camera)}, it must be a camera')
    if camera.get('camera_model', 'pinhole') != 'pinhole':
        raise ValueError(f'camera_model of {name} is {shown(camera["camera_model"])}, it must be pinhole: rectify the '
                         'images with the tool they were calibrated with, and give a calibration of the result')
    return {**camera, 'distortion_coefficients': needed(camera, 'distortion_coeffs')}


def _raw_pair(
    left: Mapping[str, Any], right: Mapping[str, Any], right_from_left: Matrix, source: str
) -> StereoCalibration:
    cameras = {'left': left, 'right': right}
    sizes = {side: _size_of(needed(camera, 'resolution'), f'resolution of the {side} camera')
             for side, camera in cameras.items()}
    _check_same_size(sizes)
    k, d = [], []
    for side, camera in cameras.items():
        needed(camera, 'distortion_model')
        f_x, f_y, c_x, c_y = _array(camera, 'intrinsics', (4,), side)
        k.append(np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]))
        d.append(_distortion(camera, side, _RADTAN))
    return stereo_rectified(sizes['left'], (k[0], k[1]), (d[0], d[1]), right_from_left, source)


def _ros_camera(camera: Mapping[str, Any], side: str, size: Size) -> CameraCalibration:
    return CameraCalibration(
        size, _array(camera, 'camera_matrix', (3, 3), side),
        _distortion(camera, side, (*_RADTAN, 'rational_polynomial')),
        _array(camera, 'rectification_matrix', (3, 3), side), _array(camera, 'projection_matrix', (3, 4), side))


def _distortion(camera: Mapping[str, Any], side: str, models: Sequence[str]) -> Matrix:
    """In OpenCV's order (5,), (8,), (12,) or (14,)."""
    model = camera.get('distortion_model', '')
    if model and model not in models:
        raise ValueError(f'distortion_model of the {side} camera is {shown(model)}, it must be {" or ".join(models)}: '
                         'rectify the images with the tool they were calibrated with, and give a calibration of the '
                         'result')
    allowed = _COEFFICIENTS[model or '']
    count = ' or '.join(map(str, allowed))
    d = _numbers(camera, 'distortion_coefficients', side, count)
    if len(d) not in allowed:
        raise ValueError(f'distortion_coefficients of the {side} camera must be {count} numbers'
                         f'{f" ({model})" if model else ""}, it has {len(d)}')
    return np.append(d, 0.0) if len(d) == 4 else d


def _check_same_size(sizes: Mapping[str, Size]) -> None:
    if sizes['left'] != sizes['right']:
        told = ', '.join(f'{side} {width}x{height}' for side, (width, height) in sizes.items())
        raise ValueError(f'the calibrations are of images of different sizes: {told} px')


def _size_of(value: Any, what: str) -> Size:
    if not isinstance(value, list) or len(value) != 2 or not all(
            isinstance(px, int) and 0 < px <= LARGEST_SIDE for px in value):
        raise ValueError(f'{what} is {shown(value)}, it must be [width, height] in px, up to {LARGEST_SIDE}')
    return value[0], value[1]


def _transform(camera: Mapping[str, Any], name: str, side: str) -> Matrix:
    """(4, 4), a rotation and a shift."""
    matrix = _array(camera, name, (4, 4), side)
    if not is_rotation(matrix[:3, :3]):
        raise ValueError(f'{name} of the {side} camera must be a rotation and a shift, 4 x 4 numbers: calibrate anew')
    return matrix


def _array(camera: Mapping[str, Any], name: str, shape: tuple[int, ...], side: str) -> Matrix:
    count = int(np.prod(shape))
    numbers = _numbers(camera, name, side, str(count))
    if numbers.size != count:
        raise ValueError(f'{name} of the {side} camera must be {count} numbers, it has {numbers.size}')
    return numbers.reshape(shape)


def _numbers(camera: Mapping[str, Any], name: str, side: str, count: str) -> Matrix:
    """All of a list of numbers, of rows, or of a matrix as OpenCV writes it: rows, cols, data. count: for messages."""
    value = needed(camera, name)
    numbers = value.get('data') if isinstance(value, dict) else value
    try:
        array = np.array(numbers, np.float64).ravel()
    except (TypeError, ValueError, OverflowError):
        array = np.array([np.nan])
    if not (np.abs(array) < LARGEST_NUMBER).all():
        raise ValueError(f'{name} of the {side} camera must be {count} numbers below {LARGEST_NUMBER:g}, it is '
                         f'{shown(numbers)}')
    return array
