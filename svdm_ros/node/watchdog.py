"""Turns counters into one line a problem: what is missing and what to do about it. Free of ROS and of clocks."""
from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable

from .log_lines import Line

_NS = 1e-9
_CLOCKS_DIFFER_NS = 1_000_000_000


@dataclasses.dataclass(frozen=True, slots=True)
class Traffic:
    """What has come so far (totals), who publishes, and how near the stamps of the two sides came of late.

    hint: what may be the matter where images are missing, or empty; asked only then.
    """

    left: int
    right: int
    pairs: int
    left_publishers: int
    right_publishers: int
    closest_gap_ns: int | None
    tolerance_ns: int
    hint: Callable[[], str] = lambda: ''


class Watchdog:
    """Says what is missing once it has been missing for `patience` seconds while the rest was there."""

    def __init__(
        self, left_topic: str, right_topic: str, now: float, patience: float = 5.0,
        names: tuple[str, str] = ('left/image_rect', 'right/image_rect'),
    ) -> None:
        """names: the topics' names before they are remapped. Both topics are one where an image holds both views."""
        self._names = names
        self._left_topic = left_topic
        self._right_topic = right_topic
        self._patience = patience
        self._counts = {'left': 0, 'right': 0, 'pairs': 0}
        self._last_came = dict.fromkeys(self._counts, now)
        self._began = dict.fromkeys(self._counts, now)  # the first of those that came without a longer pause
        self._gap_ns: int | None = None

    def check(self, now: float, traffic: Traffic) -> Line | None:
        """The line for the state at `now` (s, any clock that runs evenly); None while all is well."""
        for name in self._counts:
            self._update(name, getattr(traffic, name), now)
        if traffic.closest_gap_ns is not None:
            self._gap_ns = traffic.closest_gap_ns
        if self._is_silent('left', now) and self._is_silent('right', now):
            return Line('nothing', _with_hint(self._nothing(traffic), traffic))
        for silent, there in (('left', 'right'), ('right', 'left')):
            if self._is_silent(silent, now, self._began[there]):
                return Line('one side', _with_hint(self._one_side(traffic, silent), traffic))
        if self._is_silent('pairs', now, max(self._began['left'], self._began['right'])):
            return Line('apart', self._apart(traffic))
        return None

    def _update(self, name: str, count: int, now: float) -> None:
        if count != self._counts[name]:
            if self._counts[name] == 0 or self._is_silent(name, now):
                self._began[name] = now
            self._counts[name] = count
            self._last_came[name] = now

    def _is_silent(self, name: str, now: float, since: float = -math.inf) -> bool:
        """Whether nothing came for as long as the patience lasts, counted from `since` at the earliest."""
        return now - max(self._last_came[name], since) >= self._patience

    def _nothing(self, traffic: Traffic) -> str:
        topics = dict.fromkeys([self._left(traffic), self._right(traffic)])
        if traffic.left_publishers or traffic.right_publishers:
            return (
                f'no images for {self._patience:g} s, though there are publishers on {" and ".join(topics)}: check '
                'that they run and that large messages get through'
            )
        topics = dict.fromkeys([self._left_topic, self._right_topic])
        remaps = ' '.join(f'-r {name}:=...' for name in dict.fromkeys(self._names))
        return (
            f'no images for {self._patience:g} s, nobody publishes on {" and ".join(topics)}: start the cameras, or '
            f'remap with --ros-args {remaps}'
        )

    def _one_side(self, traffic: Traffic, silent: str) -> str:
        there, missing, name = self._right_topic, self._left(traffic), self._names[0]
        if silent == 'right':
            there, missing, name = self._left_topic, self._right(traffic), self._names[1]
        return (
            f'images on {there} but none for {self._patience:g} s on {missing}: start that camera, or remap with '
            f'--ros-args -r {name}:=...'
        )

    def _apart(self, traffic: Traffic) -> str:
        text = f'no pair for {self._patience:g} s: the stamps of {self._left_topic} and {self._right_topic} '
        tolerance = traffic.tolerance_ns * _NS
        if self._gap_ns is None or self._gap_ns <= traffic.tolerance_ns:
            return text + 'do not advance together: check how the drivers stamp their images'
        gap = self._gap_ns * _NS
        text += f'are at least {gap:.6f} s apart, approximate_sync_tolerance is {tolerance:g} s: '
        if self._gap_ns >= _CLOCKS_DIFFER_NS:
            return text + 'synchronise the clocks of the two cameras'
        return text + f'trigger the cameras together, or set approximate_sync_tolerance to {rounded_up(gap):g}'

    def _left(self, traffic: Traffic) -> str:
        return f'{self._left_topic} ({_publishers(traffic.left_publishers)})'

    def _right(self, traffic: Traffic) -> str:
        return f'{self._right_topic} ({_publishers(traffic.right_publishers)})'


def _with_hint(text: str, traffic: Traffic) -> str:
    hint = traffic.hint()
    return f'{text}; {hint}' if hint else text


def _publishers(count: int) -> str:
    return f'{count} publisher' if count == 1 else f'{count} publishers'


def rounded_up(gap: float) -> float:
    """One and a half times a gap (s), up to two digits: stamps jitter."""
    wanted = 1.5 * gap
    unit = 10.0 ** (math.floor(math.log10(wanted)) - 1)
    return math.ceil(wanted / unit) * unit
