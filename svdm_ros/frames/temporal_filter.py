"""Disparities smoothed over time, for cameras that stand or move slowly."""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_JUMP = 1.0
"""px; where a disparity changes by more, its past is forgotten."""


class TemporalFilter:
    """An exponential mean of each pixel's disparities: what comes out depends on what came before.

    Starts anew where the size or the `setting` changes.
    """

    def __init__(self) -> None:
        self._mean = np.zeros((0, 0), np.float32)
        self._setting: object = None

    def __call__(
        self, disparity: NDArray[np.float32], known: NDArray[np.bool_], weight: float, setting: object
    ) -> NDArray[np.float32]:
        """The smoothed map, float32 (H, W), px; weight: of the past, 0 .. 1.

        Pixels that are not known stay as they are, and have no past at the next frame.
        """
        if weight == 0 or self._mean.shape != disparity.shape or setting != self._setting:
            self._setting = setting
            self._mean = np.full(disparity.shape, np.nan, np.float32)
        step = self._mean - disparity
        steady = known & (np.abs(step) <= _JUMP)  # False for NaN
        smoothed = disparity + np.where(steady, np.float32(weight) * step, np.float32(0))
        self._mean = np.where(known, smoothed, np.float32(np.nan))
        return smoothed
