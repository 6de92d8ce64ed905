"""The right image's brightness and contrast brought to the left's."""
from __future__ import annotations

from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

Pixels = NDArray[Any]  # of uint8 or uint16

_SAMPLES = 4  # every so many pixels across and down
_FLAT = 1.0
"""Grey levels; images whose standard deviation is less have no contrast to be matched."""
_MOST = 4.0
"""The largest change of contrast, up and down."""


class Exposure(NamedTuple):
    """What makes the right image like the left: right * gain + offset, grey levels."""

    gain: float
    offset: float

    def differs_much(self, full_scale: int) -> bool:
        """Contrast by more than a quarter, or brightness by more than a tenth of the full scale."""
        return not (0.8 <= self.gain <= 1.25 and abs(self.offset) <= 0.1 * full_scale)


def exposure_of(left: Pixels, right: Pixels) -> Exposure:
    """From means and standard deviations over both images; gain 1 and offset 0 where one of them is flat."""
    means, deviations = zip(*(cv2.meanStdDev(_grey(image)) for image in (left, right)), strict=True)
    of_left, of_right = float(deviations[0].item()), float(deviations[1].item())
    if of_left < _FLAT or of_right < _FLAT:
        return Exposure(1.0, 0.0)
    gain = min(max(of_left / of_right, 1 / _MOST), _MOST)
    return Exposure(gain, float(means[0].item()) - gain * float(means[1].item()))


def matched(right: Pixels, exposure: Exposure) -> Pixels:
    """The right image as the left camera would have taken it; same shape and type."""
    most = np.iinfo(right.dtype).max
    table = np.clip(np.rint(exposure.gain * np.arange(most + 1) + exposure.offset), 0, most).astype(right.dtype)
    return np.asarray(cv2.LUT(right, table)) if right.dtype == np.uint8 else table[right]


def _grey(image: Pixels) -> Pixels:
    some = np.ascontiguousarray(image[::_SAMPLES, ::_SAMPLES])
    return some if some.ndim == 2 else np.asarray(cv2.cvtColor(some, cv2.COLOR_BGR2GRAY))
