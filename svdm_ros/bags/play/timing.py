"""When each message of a recording is due, and how late it was. Free of ROS; times are integers (ns)."""
from __future__ import annotations

import dataclasses
from collections import Counter

_DEFAULT_GAP = 100_000_000
"""ns between two passes of a recording whose messages all have one and the same time."""


class Schedule:
    """Recording time to monotonic time, pass by pass.

    Each message is due by the distance from the first one, so nothing adds up. A pass begins one mean period of the
    busiest topic after the last message of the one before, as if the recording went on.
    """

    def __init__(self, first_ns: int, now_ns: int, rate: float = 1.0) -> None:
        """first_ns: recording time that is due at the monotonic time now_ns; rate: times as fast as recorded."""
        self._rate = rate
        self._origin = now_ns
        self._first = self._last = first_ns
        self._counts: Counter[str] = Counter()

    def due(self, topic: str, time_ns: int) -> int:
        """The monotonic time (ns) of a message; to be asked once for each."""
        self._counts[topic] += 1
        self._last = max(self._last, time_ns)
        return self._origin + round((time_ns - self._first) / self._rate)

    def recording_time(self, now_ns: int) -> int:
        """The recording time (ns) at a monotonic time, that of the first message at least."""
        return self._first + max(0, round((now_ns - self._origin) * self._rate))

    def next_pass(self) -> None:
        """The recording begins anew."""
        length = self._last - self._first
        busiest = max(self._counts.values(), default=1)
        gap = round(length / (busiest - 1)) if busiest > 1 and length > 0 else _DEFAULT_GAP
        self._origin += round((length + gap) / self._rate)
        self._counts.clear()


@dataclasses.dataclass(slots=True)
class Lateness:
    """How much later than due messages went out, ns."""

    count: int = 0
    total: int = 0
    largest: int = 0

    def note(self, late_ns: int) -> None:
        """Take in one message."""
        self.count += 1
        self.total += max(0, late_ns)
        self.largest = max(self.largest, late_ns)

    def __str__(self) -> str:
        """The average and the largest, in ms."""
        return f'{self.total / max(1, self.count) / 1e6:.1f} ms late on average, {self.largest / 1e6:.1f} at most'
