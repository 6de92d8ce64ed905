"""Image files, read."""
from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..kernels.arrays import Image
from .image_headers import KINDS, check_size, declared_size

_LARGEST_FILE = 2**30
"""Bytes."""


def read_image(path: Path, flags: int = cv2.IMREAD_COLOR) -> Image:
    """An image as OpenCV's `flags` want it.

    ValueError where there is none, only the beginning of a PNG, or more pixels than image_headers.LARGEST.
    """
    if path.is_file() and path.stat().st_size > _LARGEST_FILE:
        raise ValueError(f'{path} has {path.stat().st_size} bytes, at most {_LARGEST_FILE} are allowed: give another '
                         'file')
    data = path.read_bytes() if path.is_file() else b''
    if data.startswith(b'\x89PNG') and b'IEND' not in data[-12:]:  # OpenCV adds lines of its own to stderr
        raise ValueError(f'{path}: a truncated PNG of {len(data)} bytes')
    size = declared_size(data)
    if size is None:
        raise ValueError(f'{path}: missing, or not an image of {KINDS}')
    try:
        check_size(*size)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None:
        raise ValueError(f'{path}: not an image of {KINDS} that can be decoded')
    return image
