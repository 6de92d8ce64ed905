"""Stage 1: the range of intensities of a pair, so that costs do not depend on exposure, contrast or bit depth.

Only differences of intensities are compared. The range follows from the pair alone, without memory of earlier frames:
a recording gives the same disparities wherever one starts.
"""
from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import DTypeLike

from ..kernels.arrays import Image

_SAMPLES = 4096
"""Values of each image that are looked at: at least so many, below four times as many, or all."""

_TAIL, _OUTERMOST = 0.02, 0.002
"""A tail is this share of the samples, without the outermost: dead pixels, lamps."""

_SPREAD = 0.82
"""Intensity between the means of the two tails: the geometric mean of 15 well exposed 8-bit pairs (Middlebury v3)."""

_LEAST_SPREAD = 4.0
"""Grey levels; tails closer together count as this far apart, which bounds the gain."""

_8_BIT = 255


class IntensityRange(NamedTuple):
    """Intensity of grey level v: (v - offset) * gain.

    offset: grey levels of the image. gain: intensity of one grey level.
    """

    offset: float
    gain: float

    @classmethod
    def full(cls, dtype: DTypeLike) -> IntensityRange:
        """Intensity 0..1 for all that uint8 or uint16 can hold."""
        return cls(0.0, 1 / np.iinfo(dtype).max)

    @classmethod
    def of(cls, left: Image, right: Image) -> IntensityRange:
        """Of a pair, both uint8 or both uint16, (H, W) or (H, W, C): all pairs get the same spread of intensities.

        The spread is the distance between the means of the brightest and the darkest 2 %, without the outermost 0.2 %.
        Intensity 0 lies half way between them. Pixels of value 0 do not count: they are underexposed, or lie outside
        the camera's image where rectification fills with black.
        """
        values = np.concatenate([_samples(left), _samples(right)])
        values.sort(kind='stable')  # radix sort
        values = values[np.searchsorted(values, 0, side='right'):]
        if values.size == 0:
            return cls.full(left.dtype)
        outermost = int(_OUTERMOST * values.size)
        count = max(1, int(_TAIL * values.size) - outermost)
        low, high = _mean(values[outermost:][:count]), _mean(values[::-1][outermost:][:count])
        return cls((low + high) / 2, _SPREAD / max(high - low, _LEAST_SPREAD))

    def levels(self, dtype: DTypeLike) -> Levels:
        """How images of `dtype` become 8-bit levels.

        Those of uint8 stay as they are: rounded to others they would have edges where there are none.
        """
        if np.dtype(dtype) == np.uint8:
            return Levels(0.0, 1.0, _8_BIT * self.gain)
        if self.offset == 0:
            return Levels(0.0, _8_BIT * self.gain, 1.0)
        return Levels(self.offset - 128 / (_8_BIT * self.gain), _8_BIT * self.gain, 1.0)


class Levels(NamedTuple):
    """The 8-bit level of value v of an image: rint((v - offset) * gain), 0 .. 255. unit: one level in 1/255 of
    intensity, which is what the parameters call a grey level."""

    offset: float
    gain: float
    unit: float


def _samples(image: Image) -> Image:
    """Every n-th pixel of every n-th row, all channels, flat."""
    n = max(1, math.isqrt(image.size // _SAMPLES))
    return image[::n, ::n].reshape(-1)


def _mean(values: Image) -> float:
    return float(values.sum(dtype=np.int64)) / values.size  # exact sum: the order does not matter
