"""Disparity maps as files: PFM, KITTI's 16-bit PNG, NPY."""
from __future__ import annotations

import io
from pathlib import Path

import cv2
import numpy as np

from ..kernels.arrays import Float32, Image, Uint16
from .pfm import encode_pfm

SUFFIXES = ('.pfm', '.png', '.npy')
KITTI_SCALE = 256  # steps of a pixel in a 16-bit PNG


def check_suffix(path: Path) -> None:
    """ValueError naming the suffixes there are where `path` has another."""
    if path.suffix.lower() not in SUFFIXES:
        raise ValueError(f'{path}: the suffix {path.suffix!r} is not allowed: it must be {" | ".join(SUFFIXES)}')


def encode_disparity(disparity: Float32, path: Path) -> bytes:
    """The file `path` shall hold, by its suffix. disparity: float32 (H, W), px, not finite where unknown.

    PFM and NPY hold the values as they are; PNG holds 256 times the disparity, 0 where unknown.
    Raises ValueError for another suffix, and for disparities that a PNG cannot hold: below 0, or too large.
    """
    check_suffix(path)
    suffix = path.suffix.lower()
    if suffix == '.pfm':
        return encode_pfm(disparity)
    if suffix == '.npy':
        file = io.BytesIO()
        np.save(file, disparity, allow_pickle=False)
        return file.getvalue()
    return encode_png(_kitti_steps(disparity, path))


def encode_png(image: Image) -> bytes:
    """A PNG of an image of 8 or 16 bit."""
    return cv2.imencode('.png', image)[1].tobytes()


def _kitti_steps(disparity: Float32, path: Path) -> Uint16:
    known = np.isfinite(disparity)
    steps = np.rint(np.where(known, disparity, 0).astype(np.float64) * KITTI_SCALE)
    if steps.max(initial=0) > np.iinfo(np.uint16).max:
        raise ValueError(f'{path}: disparities up to {disparity[known].max():g} px do not fit a 16-bit PNG, which ends '
                         f'below {2**16 // KITTI_SCALE} px: name a .pfm or .npy')
    if steps.min(initial=0) < 0:
        raise ValueError(f'{path}: disparities from {disparity[known].min():g} px do not fit a 16-bit PNG, which has '
                         'none below 0: name a .pfm or .npy')
    # A known disparity of 0 px takes the smallest step: 0 means unknown.
    return np.where(known, np.maximum(steps, 1), 0).astype(np.uint16)
