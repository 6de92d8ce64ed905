"""What a steady run has to keep to: memory, losses and latency, from its beginning to its end."""
from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Mapping, Sequence
from itertools import chain

import numpy as np

from .tally import MEGABYTE, Minute, Tally

MOST_GROWTH = 10.0
"""MB of RSS, from the median of the first minute to that of the last."""
MOST_SLOWER = 1.5
"""p99 of the last minutes, divided by that of the first."""
_MINUTES = 10
"""How many of them are compared; a third of a shorter run."""
_MOMENTS = 7
"""At which the memory is told."""


@dataclasses.dataclass(frozen=True, slots=True)
class Steadiness:
    """rss: (minute, MB) at some moments, each the median of that minute. hourly: how fast RSS grows after the first
    third, MB an hour. sent: pairs, by the camera. pairs, published, dropped: by the node. minutes: how many p99_first
    and p99_last (ms) are about."""

    rss: Sequence[tuple[int, float]]
    hourly: float
    sent: int
    pairs: int
    published: int
    dropped: Mapping[str, int]
    minutes: int
    p99_first: float
    p99_last: float

    @property
    def growth(self) -> float:
        """MB."""
        return self.rss[-1][1] - self.rss[0][1] if self.rss else float('nan')

    @property
    def lost(self) -> int:
        """Pairs that were never published."""
        return self.pairs - self.published

    @property
    def faults(self) -> list[str]:
        """Which limits are broken; NaN breaks its limit."""
        found = {f'RSS grew by more than {MOST_GROWTH:g} MB': self.growth <= MOST_GROWTH,
                 'pairs were lost between pairing and publishing': self.lost == 0 < self.published,
                 f'p99 of the last minutes is more than {MOST_SLOWER:g} times that of the first':
                     self.p99_last <= MOST_SLOWER * self.p99_first}
        return [fault for fault, is_kept in found.items() if not is_kept]

    def lines(self) -> list[str]:
        """For people."""
        rss = ', '.join(f'{size:.1f} in minute {minute}' for minute, size in self.rss)
        reasons = ''.join(f', {count} {reason}' for reason, count in self.dropped.items())
        return [f'RSS (MB): {rss}; growth {self.growth:+.1f} (at most {MOST_GROWTH:g}), '
                f'{self.hourly:+.1f} an hour after the first third',
                f'lost: {self.lost} of {self.pairs} pairs between pairing and publishing (none allowed{reasons}), '
                f'{self.sent - self.pairs} of {self.sent} sent before pairing',
                f'p99: {self.p99_first:.1f} ms in the first {self.minutes} min, {self.p99_last:.1f} in the last, '
                f'{self.p99_last / self.p99_first:.2f} times (at most {MOST_SLOWER:g})']


def steadiness(tally: Tally) -> Steadiness:
    """Of a run that is over; only whole minutes count where there is one."""
    whole = [minute for minute in tally.minutes if minute.rss]
    whole = whole[:max(1, int(tally.samples[-1][0] + 1) // 60)] if tally.samples else []
    length = min(_MINUTES, max(1, len(whole) // 3))
    moments = sorted({round(moment) for moment in np.linspace(0, len(whole) - 1, _MOMENTS)}) if whole else []
    rss = [(number + 1, statistics.median(whole[number].rss) / MEGABYTE) for number in moments]
    return Steadiness(rss, tally.slope, tally.total('sent'), tally.pairs, tally.published,
                      tally.dropped, length, _p99(whole[:length]), _p99(whole[-length:]))


def _p99(minutes: Sequence[Minute]) -> float:
    return Minute(latencies=list(chain.from_iterable(minute.latencies for minute in minutes))).p99
