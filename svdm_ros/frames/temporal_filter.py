"""Disparities smoothed over time, for cameras that stand or move slowly."""
from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

_JUMP = 1.0
"""px; where a disparity changes by more, its past is forgotten."""

_PAUSE = 1.0
"""s; after a longer one, or where time goes back, the past is forgotten."""


class TemporalFilter:
    """An exponential mean of each pixel's disparities: what comes out depends on what came before.

    Starts anew where the size or the `setting` changes, and after a pause.
    """

    def __init__(self) -> None:
        self._mean: NDArray[np.float32] | None = None
        self._before: tuple[float, object] = (0.0, None)

    def __call__(
        self, disparity: NDArray[np.float32], known: NDArray[np.bool_], weight: float, now: float, setting: object
    ) -> NDArray[np.float32]:
        """The smoothed map, float32 (H, W), px; weight: of the past, 0 (off) .. 1; now: s.

        Pixels that are not known stay as they are, and have no past at the next frame.
        """
        past, self._mean = self._mean, None
        (then, before), self._before = self._before, (now, setting)
        if weight == 0:
            return disparity
        smoothed = disparity
        if past is not None and past.shape == disparity.shape and before == setting and 0 <= now - then <= _PAUSE:
            step = past - disparity
            steady = known & (np.abs(step) <= _JUMP)  # False for NaN
            smoothed = disparity + np.where(steady, np.float32(weight) * step, np.float32(0))
        self._mean = np.where(known, smoothed, np.float32(np.nan))
        return smoothed
