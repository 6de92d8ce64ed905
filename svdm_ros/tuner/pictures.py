"""The pictures of the page, as JPEG."""
from __future__ import annotations

import base64

import cv2
import numpy as np
from numpy.typing import NDArray

from ..frames.colours import coloured
from .shot import Shot, grey_bytes

_WIDEST = 960
"""px; a wider picture is shrunk."""
_QUALITY = 85
_LARGE_ERROR = 4.0
"""px, of the images matched; drawn in full red or blue."""
_DIFFERENT = 1.0
"""px; from here on two maps differ."""
_NEARER, _FARTHER = (60, 60, 255), (255, 140, 40)
"""BGR: red and blue."""

Picture = NDArray[np.uint8]


def left_picture(shot: Shot) -> Picture:
    """The left image."""
    return grey_bytes(shot.left)


def disparity_picture(shot: Shot) -> Picture:
    """Blue is the smallest disparity of the search range, red the largest, black unknown."""
    picture = coloured(np.where(shot.known, shot.disparity, np.float32(shot.limits[0])), *shot.limits)
    picture[~shot.known] = 0
    return picture


def confidence_picture(shot: Shot) -> Picture:
    """White is 1, black 0."""
    if shot.confidence is None:
        return np.zeros(shot.disparity.shape, np.uint8)
    return np.asarray(cv2.convertScaleAbs(shot.confidence, alpha=255), np.uint8)


def error_picture(shot: Shot) -> Picture:
    """White is right, red too near and blue too far by 4 px or more, black unknown; black all over without truth."""
    error = shot.error
    if error is None:
        return np.zeros((*shot.disparity.shape, 3), np.uint8)
    known = np.isfinite(error)
    size = np.minimum(np.abs(np.where(known, error, 0)) / _LARGE_ERROR, 1)[..., None]
    is_nearer = np.where(known, error, 0) > 0
    side = np.where(is_nearer[..., None], np.array(_NEARER, np.float32), np.array(_FARTHER, np.float32))
    picture = np.asarray((1 - size) * 255 + size * side, np.uint8)
    picture[~known] = 0
    return picture


def difference_picture(first: Shot, second: Shot) -> Picture:
    """The left image in pale grey; red where the second map is nearer by more than 1 px, blue where it is farther, grey
    where only one of them knows a disparity."""
    grey = left_picture(second)
    grey = np.asarray(cv2.cvtColor(grey, cv2.COLOR_BGR2GRAY)) if grey.ndim == 3 else grey
    picture = np.repeat((128 + grey // 3)[..., None], 3, axis=2).astype(np.uint8)
    if first.disparity.shape != second.disparity.shape or picture.shape[:2] != second.disparity.shape:
        return picture
    change = second.disparity - first.disparity
    both = first.known & second.known
    picture[both & (change > _DIFFERENT)] = _NEARER
    picture[both & (change < -_DIFFERENT)] = _FARTHER
    picture[first.known != second.known] = 60
    return picture


def different_share(first: Shot, second: Shot) -> float | None:
    """Share (%) of the pixels whose disparities differ by more than 1 px, or that only one map knows; None where the
    maps have different sizes."""
    if first.disparity.shape != second.disparity.shape:
        return None
    both = first.known & second.known
    apart = both & (np.abs(second.disparity - first.disparity) > _DIFFERENT)
    return 100 * float((apart | (first.known != second.known)).mean())


def as_uri(picture: Picture) -> str:
    """A JPEG for the src of an image."""
    height, width = picture.shape[:2]
    if width > _WIDEST:
        size = (_WIDEST, max(1, round(height * _WIDEST / width)))
        picture = np.asarray(cv2.resize(picture, size, interpolation=cv2.INTER_AREA), np.uint8)
    done, data = cv2.imencode('.jpg', picture, [cv2.IMWRITE_JPEG_QUALITY, _QUALITY])
    if not done:
        raise ValueError(f'a picture of {width}x{height} px cannot be written as JPEG')
    return f'data:image/jpeg;base64,{base64.b64encode(data).decode()}'
