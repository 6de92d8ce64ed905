"""Image files, read."""
from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from ..kernels.arrays import Image


def read_image(path: Path, flags: int = cv2.IMREAD_COLOR) -> Image:
    """An image as OpenCV's `flags` want it. ValueError where there is none, or only the beginning of a PNG."""
    data = path.read_bytes() if path.is_file() else b''
    if data.startswith(b'\x89PNG') and b'IEND' not in data[-12:]:  # OpenCV adds lines of its own to stderr
        raise ValueError(f'{path}: a truncated PNG of {len(data)} bytes')
    image = cv2.imdecode(np.frombuffer(data, np.uint8), flags) if data else None
    if image is None:
        raise ValueError(f'{path}: missing, or not an image')
    return image
