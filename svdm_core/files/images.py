"""Image files, read."""
from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..kernels.arrays import Image
from .image_headers import KINDS, check_size, declared_size
from .user_files import IMAGE, check_regular


def read_image(path: Path, flags: int = cv2.IMREAD_COLOR) -> Image:
    """An image as OpenCV's `flags` want it.

    ValueError where there is no regular file, no image, only the beginning of a PNG, or more pixels than
    image_headers.LARGEST.
    """
    check_regular(path, IMAGE)
    data = path.read_bytes()
    if data.startswith(b'\x89PNG') and b'IEND' not in data[-12:]:  # OpenCV adds lines of its own to stderr
        raise ValueError(f'{path}: a truncated PNG of {len(data)} bytes')
    size = declared_size(data)
    if size is None:
        raise ValueError(f'{path}: not an image of {KINDS}')
    try:
        check_size(*size)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags)
    if image is None:
        raise ValueError(f'{path}: not an image of {KINDS} that can be decoded')
    return image
