"""What the stamps of a camera tell of images that have not come. Free of ROS: stamps are integers (ns)."""
from __future__ import annotations

import bisect
import itertools
import math
import statistics
from collections import deque
from collections.abc import Sequence

from ..frames.stereo_pairing import JUMP_BACK_NS

_WINDOW = 40
"""Stamps that are judged together."""
_LONGEST = 20
"""Periods; a longer gap is a pause, or a jump of time."""
_FEWEST_GAPS = 5
"""Fewer places at which images are missing say nothing."""
_OFF_BEAT = 0.2
"""Periods by which a gap may differ from a whole number of them."""
_MOST_OFF_BEAT = 0.25
"""Share of such gaps, of those that are longer than one period: with more there is no rhythm, as with a trigger."""


class StampRhythm:
    """The stamps of one topic, judged 40 at a time."""

    def __init__(self) -> None:
        self._stamps: list[int] = []
        self._shares: deque[float] = deque(maxlen=2)
        self.recent: deque[int] = deque(maxlen=_WINDOW)
        self.period_ns = 0.0

    def add(self, stamp: int) -> None:
        """The stamp of an image that came, ns."""
        self.recent.append(stamp)
        if self._stamps and stamp < self._stamps[-1] - JUMP_BACK_NS:
            self._stamps = []
        bisect.insort(self._stamps, stamp)
        if len(self._stamps) == _WINDOW:
            self.period_ns, share = missing_share(self._stamps)
            self._shares.append(share)
            self._stamps = [stamp]

    @property
    def missing(self) -> float:
        """Share of images that did not come, 0 .. 1: what the last two windows have both, as a change of rate is in one
        only."""
        return min(self._shares) if len(self._shares) == 2 else 0.0


def missing_share(stamps: Sequence[int]) -> tuple[float, float]:
    """The period (ns) and the share of its beats without a stamp; stamps in ns, ascending. Share 0 without a rhythm.

    The period is the longest of which nearly all gaps hold whole numbers: a short gap (the shortest may be due to
    jitter), or a half or a third of it, where nearly all gaps hold several.
    """
    gaps = [later - earlier for earlier, later in itertools.pairwise(stamps) if later > earlier]
    if len(gaps) < 2 * _FEWEST_GAPS:
        return 0.0, 0.0
    short = sorted(gaps)[len(gaps) // 10]
    for part in (1, 2, 3):
        period = _fitted(gaps, short / part)
        beats = [gap / period for gap in gaps if gap <= (_LONGEST + _OFF_BEAT) * period]
        longer = [beat for beat in beats if beat > 1 + _OFF_BEAT]
        off = sum(abs(beat - round(beat)) > _OFF_BEAT for beat in longer)
        if off <= _MOST_OFF_BEAT * len(longer):
            whole = [max(round(beat), 1) for beat in beats]
            return period, 1 - len(whole) / sum(whole) if len(longer) >= _FEWEST_GAPS else 0.0
    return float(short), 0.0


def _fitted(gaps: Sequence[int], period: float) -> float:
    """The median of all gaps over the whole numbers of periods that they hold."""
    for _ in range(2):
        period = statistics.median(gap / max(round(gap / period), 1) for gap in gaps)
    return period


def usual_gap(left: Sequence[int], right: Sequence[int], above: int) -> float:
    """Of the distances between each left stamp and its nearest right one that are larger than `above`: what nine of ten
    do not exceed, ns; infinity where there are none."""
    ordered = sorted(right)
    distances = sorted(distance for stamp in left if (distance := _nearest(ordered, stamp)) > above)
    return distances[len(distances) * 9 // 10] if distances else math.inf


def _nearest(ordered: Sequence[int], stamp: int) -> float:
    place = bisect.bisect_left(ordered, stamp)
    return min((abs(other - stamp) for other in ordered[max(place - 1, 0):place + 1]), default=math.inf)
