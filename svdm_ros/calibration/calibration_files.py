"""Calibration files of a stereo pair, told apart by what is in them."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NoReturn

from svdm_core.files.user_files import SETTINGS, read_text

from .stereo_calibration import StereoCalibration
from .text_calibrations import read_text_calibration
from .yaml_calibrations import euroc, is_camera, is_kalibr, kalibr, load_yaml, right_file_of, ros

KINDS = 'calib.txt or calib_cam_to_cam.txt of KITTI or DrivingStereo, calib.txt of Middlebury v3 or ETH3D, ' \
        'sensor.yaml of EuRoC (cam0, cam1), camchain.yaml of Kalibr, yaml of ROS camera_calibration (left, right)'
COLOUR_FOLDERS = ('image_2', 'image_3', 'image_02', 'image_03')
"""KITTI's folders of the colour cameras, 2 and 3; its grey ones are 0 and 1."""
_OTHERS = {
    '[narrow_stereo': 'ost.txt of ROS camera_calibration: give the yaml files that it writes beside it',
    '[LEFT_CAM_': 'the factory calibration of a ZED: record the images that its driver rectifies',
    'LEFT.K:': 'the settings of ORB-SLAM: give the calibration that they were made of',
    'Camera.fx': 'the settings of ORB-SLAM: give the calibration that they were made of',
    'Camera1.fx': 'the settings of ORB-SLAM: give the calibration that they were made of',
    'M1:': "intrinsics of OpenCV's stereo_calib: write its matrices as yaml of ROS camera_calibration",
}
"""Words of files that people have and that are not read, and what to say of them."""


def read_calibration(files: Sequence[Path], colour: bool) -> StereoCalibration:
    """The calibration in `files`: one of the pair, or one of each camera, left first.

    colour: of KITTI's two pairs of cameras, take that of the colour images (2 and 3).
    Raises ValueError naming the file, and the key that is missing or wrong.
    """
    if len(files) > 2:
        raise ValueError(f'--calib is given {len(files)} times: once, or twice for a file of each camera, left first')
    text = _read(files[0])
    try:
        if files[0].suffix.lower() not in ('.yaml', '.yml'):
            _check_of_both(files)
            return read_text_calibration(text, colour) or _refuse(text)
        left = load_yaml(text)
        if is_kalibr(left):
            _check_of_both(files)
            return kalibr(left)
        if not is_camera(left):
            _refuse(text)
        right_file = files[1] if len(files) == 2 else right_file_of(files[0])
    except ValueError as error:
        raise ValueError(f'{files[0]}: {error}') from None
    right_text = _read(right_file)
    try:
        return (euroc if 'T_BS' in left else ros)(left, load_yaml(right_text))
    except ValueError as error:
        raise ValueError(f'{files[0]} and {right_file}: {error}') from None


def _read(path: Path) -> str:
    if not path.exists():
        raise ValueError(f'{path}: there is no such file; --calib takes {KINDS}')
    return read_text(path, SETTINGS)


def _check_of_both(files: Sequence[Path]) -> None:
    if len(files) == 2:
        raise ValueError('is the calibration of both cameras: give --calib once')


def _refuse(text: str) -> NoReturn:
    other = next((told for word, told in _OTHERS.items() if word in text), '')
    raise ValueError(f'is {other}' if other else f'is none of the calibrations known: {KINDS}')
