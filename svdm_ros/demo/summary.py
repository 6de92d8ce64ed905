"""The figures of a run: what was sent and received, how fast, how good before and after."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from svdm_core.evaluation.metrics import error_metrics

METRICS = ('avgerr', 'bad1', 'bad2', 'bad4', 'density')


class TimedFrame(Protocol):
    """What of a received frame the figures need: ns of receipt, ms from sending to receipt."""

    @property
    def received(self) -> int: ...
    @property
    def latency(self) -> float: ...


@dataclasses.dataclass(frozen=True, slots=True)
class Traffic:
    """Numbers: pairs sent, disparity images received, pairs the node left out for a newer one or before warm-up."""

    sent: int
    received: int
    superseded: int

    @property
    def lost(self) -> int:
        """Pairs sent of which nobody knows: lost on the way to the node, in it, or from it."""
        return self.sent - self.received - self.superseded

    def as_dict(self) -> dict[str, int]:
        return {
            'frames_sent': self.sent,
            'frames_received': self.received,
            'frames_superseded': self.superseded,
            'frames_lost': self.lost,
        }


def pixel_offset(disparity: NDArray[np.float32], principal_offset: float) -> NDArray[np.float32]:
    """x_l - x_r in px, as ground truth has it, from the disparity of a DisparityImage: x_l - x_r - principal_offset."""
    return disparity + np.float32(principal_offset)


def speed(frames: Sequence[TimedFrame]) -> dict[str, Any]:
    """fps of receipt, and the latency's quantiles in ms."""
    latencies = [frame.latency for frame in frames]
    p50, p95 = np.percentile(latencies, [50, 95])
    seconds = (frames[-1].received - frames[0].received) / 1e9
    return {
        'fps': round((len(frames) - 1) / seconds, 2) if seconds > 0 else None,
        'latency_ms': {'p50': round(float(p50), 1), 'p95': round(float(p95), 1)},
    }


def quality(offset: NDArray[np.float32], ground_truth: NDArray[np.float32]) -> dict[str, float]:
    """Error over all known ground truth in px of the image as it is: avgerr in px, bad and density in %."""
    metrics = error_metrics(offset, ground_truth)
    return {name: round(metrics[name], 3) for name in METRICS}


def changed(before: Mapping[str, Any], after: Mapping[str, Any]) -> dict[str, list[Any]]:
    """name -> [old, new] of the parameters that differ."""
    return {name: [before[name], value] for name, value in after.items() if before[name] != value}
