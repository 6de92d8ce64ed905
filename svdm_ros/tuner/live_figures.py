"""Figures of the map that is seen, which take no ground truth; and the error where there is one."""
from __future__ import annotations

import collections
import time

import numpy as np

from svdm_core.evaluation.streaks import streak_share
from svdm_core.kernels.arrays import Float32

from .shot import Shot, grey_bytes

_FLICKER_STEP = 1.0
"""px; what changes by more has moved, and does not flicker."""
_SHOTS_KEPT = 20


class LiveFigures:
    """Of one stream of shots. For one thread."""

    def __init__(self) -> None:
        self._before: tuple[Shot, object] | None = None
        self._times: collections.deque[float] = collections.deque(maxlen=_SHOTS_KEPT)

    def of(self, shot: Shot, setting: object) -> dict[str, str]:
        """setting: what the flicker follows from; with another one it is measured anew."""
        found = {}
        if shot.left.shape[:2] == shot.disparity.shape and shot.is_matched:
            found['streaks'] = f'{streak_share(_known(shot), grey_bytes(shot.left)):.2f} %'
        error = shot.error
        if error is not None:
            sizes = np.abs(error[np.isfinite(error)])
            if sizes.size:
                found['error'] = f'{sizes.mean():.2f} px, {100 * (sizes > 1).mean():.1f} % off by more than 1 px'
        before, self._before = self._before, (shot, setting)
        if before is not None and shot.is_moving and before[1] == setting:
            change = flicker(_known(before[0]), _known(shot))
            if change is not None:
                found['flicker, if the scene stands'] = f'{change:.3f} px'
        return found

    def rate(self) -> str:
        """Pairs a second, of those that this was called for; empty while there are too few."""
        now = time.monotonic()
        self._times.append(now)
        if len(self._times) < 3 or now - self._times[0] <= 0:
            return ''
        return f'{(len(self._times) - 1) / (now - self._times[0]):.1f} Hz'


def _known(shot: Shot) -> Float32:
    """float32 (H, W), px; NaN where there is no disparity."""
    return np.where(shot.known, shot.disparity, np.float32(np.nan))


def flicker(before: Float32, after: Float32) -> float | None:
    """Mean change (px) of the pixels that change by up to 1 px, of those known in both; None where sizes differ or
    nothing is comparable."""
    if before.shape != after.shape:
        return None
    change = np.abs(after - before)
    near = change <= _FLICKER_STEP
    return float(change[near].mean()) if near.any() else None
