"""PFM, the portable float map: one channel, the rows from the bottom up."""
from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ..kernels.arrays import Float32


def encode_pfm(image: Float32) -> bytes:
    """The file that holds float32 (H, W), little-endian."""
    height, width = image.shape
    return f'Pf\n{width} {height}\n-1.0\n'.encode() + image[::-1].astype('<f4').tobytes()


def read_pfm(path: Path) -> Float32:
    """A one-channel PFM as float32 (H, W), top row first. ValueError where it is none, or truncated."""
    with path.open('rb') as file:
        kind, size, scale = (file.readline(100).strip() for _ in range(3))
        data = file.read()
    try:
        width, height = map(int, size.split())
        order = '<' if float(scale) < 0 else '>'
    except ValueError:
        raise ValueError(f'{path}: not a PFM file') from None
    if kind != b'Pf':
        raise ValueError(f'{path}: a PFM of kind {kind.decode(errors="replace")!r}; one channel, Pf, is expected')
    if min(width, height) < 1 or not math.isfinite(float(scale)) or not float(scale):
        raise ValueError(f'{path}: a PFM of {width} x {height} pixels with scale {scale.decode(errors="replace")}')
    if len(data) != 4 * width * height:
        raise ValueError(f'{path}: {len(data)} bytes of data where {width} x {height} pixels take {4 * width * height}')
    return np.frombuffer(data, f'{order}f4').reshape(height, width)[::-1].astype(np.float32)
