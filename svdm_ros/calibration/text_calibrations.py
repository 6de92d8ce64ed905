"""Calibrations as text: KITTI, DrivingStereo and Middlebury v3."""
from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import numpy as np

from svdm_core.shown import shown

from .stereo_calibration import (
    LARGEST_NUMBER,
    LARGEST_SIDE,
    Matrix,
    Size,
    StereoCalibration,
    rectified_camera,
)

_DIGITS = frozenset('0123456789+-.eE')
_LONGEST_NUMBER = 64
_SEPARATORS = str.maketrans('[],;', '    ')
_SAME_OFFSET = 0.01
"""px; doffs of Middlebury is rounded to three places, and so are the principal points."""
_DRIVING_STEREO = '101', '103'
"""The names of its cameras, left and right."""


def read_text_calibration(text: str, colour: bool) -> StereoCalibration | None:
    """The calibration in a text; None where it is none of those known. Raises ValueError naming what is wrong.

    colour: of KITTI's two pairs of cameras, take that of the colour images (2 and 3).
    """
    values = _labelled(text, '=')
    return _middlebury(values) if 'cam0' in values else _kitti(text, colour)


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
        if abs(value) < LARGEST_NUMBER:
            return value
    raise ValueError(f'{told} {shown(word)}, it must be a number below {LARGEST_NUMBER:g}')


def _looks_like_a_number(word: str) -> bool:
    return len(word) <= _LONGEST_NUMBER and _DIGITS.issuperset(word)


def _size(width: float, height: float, name: str) -> Size:
    if not all(px.is_integer() and 0 < px <= LARGEST_SIDE for px in (width, height)):
        raise ValueError(f'{name} is {width:g} x {height:g}, it must be whole px from 1 to {LARGEST_SIDE}')
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
    return np.reshape(_numbers(needed(values, name), 9, name, 'a camera matrix'), (3, 3))


def _middlebury_number(values: Mapping[str, str], name: str) -> float:
    return _number(needed(values, name), f'{name} is')


# KITTI, and DrivingStereo in its notation


def _kitti(text: str, colour: bool) -> StereoCalibration | None:
    labelled = _labelled(text, ':')
    names = ('02', '03') if colour else ('00', '01')
    if 'P_rect_00' in labelled or 'P_rect_02' in labelled:
        return _rectified_pair(labelled, names, 'KITTI')
    if f'P_rect_{_DRIVING_STEREO[0]}' in labelled:
        return _rectified_pair(labelled, _DRIVING_STEREO, 'DrivingStereo')
    if 'P0' in labelled or 'P2' in labelled:
        return _pair([_kitti_matrix(labelled, f'P{name[1]}') for name in names], None, 'KITTI')
    lines = [line for line in text.splitlines() if line.strip()]
    if len(lines) in (2, 4) and all(_looks_like_a_number(word) for line in lines for word in line.split()):
        matrices = [_twelve(line, f'line {number}') for number, line in enumerate(lines, 1)]
        return _pair(matrices[-2:] if colour else matrices[:2], None, 'KITTI')
    return None


def _rectified_pair(values: Mapping[str, str], names: tuple[str, str], source: str) -> StereoCalibration:
    matrices = [_kitti_matrix(values, f'P_rect_{name}') for name in names]
    return _pair(matrices, _kitti_size(values, f'S_rect_{names[0]}'), source)


def _pair(matrices: Sequence[Matrix], size: Size | None, source: str) -> StereoCalibration:
    """KITTI counts from camera 0; here the left camera is the origin. The images are rectified."""
    left, right = (np.hstack([matrix[:, :3], np.zeros((3, 1))]) for matrix in matrices)
    right[0, 3] = matrices[1][0, 3] - matrices[0][0, 3]
    return StereoCalibration(rectified_camera(size, left), rectified_camera(size, right), source, True)


def _kitti_matrix(values: Mapping[str, str], name: str) -> Matrix:
    return _twelve(needed(values, name), name)


def _twelve(text: str, name: str) -> Matrix:
    return np.reshape(_numbers(text, 12, name, 'a projection matrix'), (3, 4))


def _kitti_size(values: Mapping[str, str], name: str) -> Size:
    width, height = _numbers(needed(values, name), 2, name, 'an image size')
    return _size(width, height, name)


def needed[Value](values: Mapping[str, Value], name: str) -> Value:
    """The value of a name. Raises ValueError where it is missing."""
    if name not in values:
        raise ValueError(f'{name} is missing')
    return values[name]
