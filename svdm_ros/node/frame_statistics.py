"""Counts of what came, what went out and what was dropped, and why. Safe to use from any thread."""
from __future__ import annotations

import dataclasses
import statistics
import threading
from collections import Counter, deque
from collections.abc import Mapping, Sequence
from typing import NamedTuple

_LATENCIES_KEPT = 100
_SHARES_KEPT = 30


class PixelShares(NamedTuple):
    """Of one frame, 0 .. 1. valid: of pixels that passed the left-right check and are unique. confident: of those
    whose confidence reaches confidence_threshold."""

    valid: float
    confident: float


@dataclasses.dataclass(frozen=True, slots=True)
class FrameCounts:
    """A snapshot: totals since the start, and `latencies` (s, arrival to publication) of late.

    `timings`: the mean milliseconds of each stage over the frames since the snapshot before, or if there were none, as
    it was then. `shares`: of the last frames.
    `defects` counts exceptions that nothing accounts for, whether they cost a frame or not.
    """

    received: Mapping[str, int]
    pairs: int
    published: int
    dropped: Mapping[str, int]
    defects: int
    latencies: tuple[float, ...]
    timings: Mapping[str, float]
    shares: tuple[PixelShares, ...] = ()

    @property
    def total_dropped(self) -> int:
        return sum(self.dropped.values())

    def dropped_text(self) -> str:
        """'12 dropped (10 superseded, 2 unreadable)', reasons by count."""
        reasons = sorted(((count, reason) for reason, count in self.dropped.items() if count), reverse=True)
        return f'{self.total_dropped} dropped' + (
            f' ({", ".join(f"{count} {reason}" for count, reason in reasons)})' if reasons else ''
        )


class FrameStatistics:
    """Collects the counts."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._received: Counter[str] = Counter(left=0, right=0)
        self._dropped: Counter[str] = Counter()
        self._pairs = self._published = self._defects = 0
        self._latencies: deque[float] = deque(maxlen=_LATENCIES_KEPT)
        self._shares: deque[PixelShares] = deque(maxlen=_SHARES_KEPT)
        self._timings: dict[str, float] = {}
        self._frames: list[Mapping[str, float]] = []

    def count_received(self, side: str) -> None:
        with self._lock:
            self._received[side] += 1

    def count_pair(self) -> None:
        with self._lock:
            self._pairs += 1

    def count_drop(self, reason: str) -> None:
        """One more frame dropped for `reason`."""
        with self._lock:
            self._dropped[reason] += 1

    def set_dropped(self, reason: str, total: int) -> None:
        """For drops that are counted elsewhere: the total so far."""
        with self._lock:
            self._dropped[reason] = total

    def count_defect(self) -> None:
        with self._lock:
            self._defects += 1

    def count_published(self, latency: float, timings: Mapping[str, float], shares: PixelShares) -> None:
        with self._lock:
            self._published += 1
            self._latencies.append(latency)
            self._shares.append(shares)
            self._frames.append(dict(timings))

    def snapshot(self) -> FrameCounts:
        """The counts as they are; what `timings` is about begins anew."""
        with self._lock:
            if self._frames:
                self._timings = _means(self._frames)
                self._frames = []
            return FrameCounts(
                received=dict(self._received),
                pairs=self._pairs,
                published=self._published,
                dropped=dict(self._dropped),
                defects=self._defects,
                latencies=tuple(self._latencies),
                timings=dict(self._timings),
                shares=tuple(self._shares),
            )


def _means(frames: Sequence[Mapping[str, float]]) -> dict[str, float]:
    """Of each stage, over the frames that have it: with other parameters there are others."""
    stages = dict.fromkeys(stage for frame in frames for stage in frame)
    return {stage: statistics.fmean(frame[stage] for frame in frames if stage in frame) for stage in stages}


class Rate:
    """How fast a total grows between two looks at it. Times in s, of any clock that runs evenly."""

    def __init__(self, now: float) -> None:
        self._total = 0
        self._looked = now

    def update(self, total: int, now: float) -> float:
        """Per second since the last look; 0 where no time has passed."""
        grown, passed = total - self._total, now - self._looked
        self._total, self._looked = total, now
        return grown / passed if passed > 0 else 0.0
