"""What the soak has counted, as a table by minute and a verdict."""
from __future__ import annotations

import dataclasses
import statistics
from collections.abc import Iterator, Sequence

import numpy as np

MEGABYTE = 1e6
_MOST_OTHER = 0.02
"""Share of the answers compared that may have another calibration."""
_SETTLING = 1 / 3
"""Share of the time at the beginning in which memory may grow."""


@dataclasses.dataclass(slots=True)
class Minute:
    """Of one minute. other_calibration: of those compared, answers with a hostile calibration that came last.
    latencies: ms from the sending of a pair to its answer, while nothing was stopped. rss: bytes of the node, sample by
    sample.
    """

    sent: int = 0
    answered: int = 0
    wrong: int = 0
    compared: int = 0
    other_calibration: int = 0
    requests: int = 0
    latencies: list[float] = dataclasses.field(default_factory=list)
    rss: list[int] = dataclasses.field(default_factory=list)

    @property
    def p99(self) -> float:
        """ms; NaN without an answer."""
        return float(np.percentile(self.latencies, 99)) if self.latencies else float('nan')


@dataclasses.dataclass(slots=True)
class Tally:
    """minutes: in their order. faults: what was wrong, by kind. deaths: of the node or a camera, unasked. samples: s
    since the start and RSS of the node, bytes. pairs, published, dropped (by reason): the node's own counts, asked at
    the end of a steady run.
    """

    minutes: list[Minute] = dataclasses.field(default_factory=list)
    faults: dict[str, list[str]] = dataclasses.field(default_factory=dict)
    deaths: int = 0
    samples: list[tuple[float, int]] = dataclasses.field(default_factory=list)
    pairs: int = 0
    published: int = 0
    dropped: dict[str, int] = dataclasses.field(default_factory=dict)

    def minute(self, seconds: float) -> Minute:
        """The one that holds a moment, s since the start."""
        while len(self.minutes) <= seconds // 60:
            self.minutes.append(Minute())
        return self.minutes[int(seconds // 60)]

    def fault(self, kind: str, text: str) -> None:
        """Note what was wrong."""
        self.faults.setdefault(kind, []).append(text)

    def total(self, name: str) -> int:
        return sum(getattr(minute, name) for minute in self.minutes)

    @property
    def slope(self) -> float:
        """How fast the node's memory grows after the first third of the time, MB an hour; NaN of few samples."""
        late = [sample for sample in self.samples if sample[0] > _SETTLING * self.samples[-1][0]]
        if len(late) < 10:
            return float('nan')
        seconds, sizes = np.array(late, float).T
        return float(np.polyfit(seconds, sizes, 1)[0]) * 3600 / MEGABYTE

    @property
    def is_well(self) -> bool:
        """Whether nothing was wrong, something was compared, and nearly all of it had its own calibration."""
        lost = self.total('other_calibration') / max(self.total('compared'), 1)
        return (not self.faults and self.deaths == 0 and self.total('wrong') == 0 and self.total('compared') > 0
                and lost <= _MOST_OTHER)


_COUNTS = ('sent', 'answered', 'compared', 'other_calibration', 'wrong', 'requests')
COLUMNS = ('minute', 'sent', 'answered', 'compared', 'other info', 'wrong', 'requests', 'p99 (ms)', 'RSS (MB)')


def rows(tally: Tally) -> Iterator[Sequence[str]]:
    """The table by COLUMNS, all minutes and their sum."""
    for number, minute in enumerate(tally.minutes):
        yield _row(str(number + 1), minute, f'{minute.p99:.0f}')
    whole = Minute(rss=[size for _, size in tally.samples])
    for name in _COUNTS:
        setattr(whole, name, tally.total(name))
    yield _row('all', whole, '')


def verdict(tally: Tally) -> str:
    """In one line."""
    return (f'deaths {tally.deaths}, wrong {tally.total("wrong")} of {tally.total("compared")} compared, '
            f'faults {sum(map(len, tally.faults.values()))}, RSS {tally.slope:+.1f} MB an hour after the first third')


def _row(name: str, minute: Minute, p99: str) -> Sequence[str]:
    rss = f'{statistics.median(minute.rss) / MEGABYTE:.0f}' if minute.rss else ''
    return (name, *(str(getattr(minute, count)) for count in _COUNTS), p99, rss)
