"""Images lost on their way, pairs that the node is too slow for, matches that fail: what lasts, and what to do."""
from __future__ import annotations

import dataclasses
import statistics
from collections import deque
from collections.abc import Iterator, Sequence
from typing import NamedTuple

from ..frames.stereo_pairing import SideName
from .frame_statistics import FrameCounts
from .log_lines import Line
from .stamp_rhythm import StampRhythm, usual_gap
from .watchdog import rounded_up

_SECONDS = 10
"""How far back the counts of images are compared; they are looked at once a second."""
_SECONDS_BEHIND = 20
"""The same of pairs that were superseded: a machine may be busy for a while."""
_FEWEST = 20
"""Images or pairs in that time that say something."""
_FEWEST_CHECKED = 30
"""Pairs, for the share of valid pixels."""
_TRANSPORT = ('give the process that publishes them the Fast DDS profile config/fastdds.xml (docs/node.md), or start '
              'this node with -p qos_overrides.{topic}.subscription.reliability:=reliable')


class Counts(NamedTuple):
    """Totals at one moment."""

    left: int
    right: int
    pairs: int
    superseded: int

    @classmethod
    def of(cls, counts: FrameCounts) -> Counts:
        return cls(counts.received['left'], counts.received['right'], counts.pairs, counts.dropped.get('superseded', 0))


@dataclasses.dataclass(frozen=True, slots=True)
class Shortfall:
    """A line whose text is empty while all is well, and what to say once it is well again."""

    line: Line
    over: str


class _Lasting:
    """Begins at one value and ends at another, so that it does not come and go."""

    def __init__(self, begins: float, ends: float) -> None:
        self._begins, self._ends = begins, ends
        self._on = False

    def update(self, value: float) -> bool:
        self._on = value >= (self._ends if self._on else self._begins)
        return self._on


class LostImages:
    """Images that the stamps tell of, and that have not come; left and right images of which few are pairs."""

    def __init__(self, topics: dict[SideName, str]) -> None:
        """topics: full name, by side; one side only where an image holds both views."""
        self._topics = topics
        self._rhythms = {side: StampRhythm() for side in topics}
        self._missing = {side: _Lasting(0.2, 0.1) for side in topics}
        self._unpaired = _Lasting(0.5, 0.3)
        self._counts: deque[Counts] = deque(maxlen=_SECONDS + 1)

    def add(self, side: SideName, stamp: int) -> None:
        """The stamp (ns) of an image that came."""
        self._rhythms[side].add(stamp)

    def check(self, counts: Counts, tolerance_ns: int) -> Iterator[Shortfall]:
        """To be called once a second."""
        self._counts.append(counts)
        lost = False
        for side, topic in self._topics.items():
            share = self._rhythms[side].missing
            text = self._lost_text(side, topic, share) if self._missing[side].update(share) else ''
            lost = lost or bool(text)
            yield Shortfall(Line(f'lost {side}', text), f'{topic}: hardly an image is missing any more')
        if len(self._topics) == 2:
            text = self._unpaired_text(tolerance_ns)
            yield Shortfall(Line('few pairs', '' if lost else text), 'left and right images find their partners again')

    def _lost_text(self, side: SideName, topic: str, share: float) -> str:
        period = self._rhythms[side].period_ns / 1e9
        return (f'{topic}: {share:.0%} of the images are missing, by stamps that are {period:.3g} s apart: if the '
                'camera sends them (or the recording holds them), they are lost on the way: '
                f'{_TRANSPORT.format(topic=topic)}')

    def _unpaired_text(self, tolerance_ns: int) -> str:
        came = [new - old for new, old in zip(self._counts[-1], self._counts[0], strict=True)]
        left, right, pairs, _ = came
        fewer = min(left, right)
        if fewer < _FEWEST or pairs <= 0 or not self._unpaired.update(1 - pairs / fewer):
            return ''
        text = f'of {left} left and {right} right images only {pairs} found their partner: '
        gap = usual_gap(self._rhythms['left'].recent, self._rhythms['right'].recent, tolerance_ns)
        if gap < 0.5 * self._rhythms['left'].period_ns:
            return (f'{text}their stamps are up to {gap / 1e9:.6f} s apart: set approximate_sync_tolerance to '
                    f'{rounded_up(gap / 1e9):g}')
        return text + f'images are lost on the way: {_TRANSPORT.format(topic=self._topics["left"])}'


class FallingBehind:
    """Pairs that newer ones replaced, as the matcher is slower than the camera."""

    def __init__(self) -> None:
        self._counts: deque[Counts] = deque(maxlen=_SECONDS_BEHIND + 1)
        self._behind = _Lasting(0.3, 0.1)

    def check(self, counts: Counts, milliseconds: float, counting: bool) -> Shortfall:
        """To be called once a second. milliseconds: that a pair takes. counting: False while pairs are dropped for
        another reason: kernels are compiled, or max_rate leaves them out."""
        if not counting:
            self._counts.clear()
        self._counts.append(counts)
        pairs = counts.pairs - self._counts[0].pairs
        superseded = counts.superseded - self._counts[0].superseded
        told = pairs >= _FEWEST and len(self._counts) > _SECONDS_BEHIND
        text = ''
        if self._behind.update(superseded / pairs if told else 0.0):
            text = (f'the node falls behind: {superseded} of {pairs} pairs in {_SECONDS_BEHIND} s were dropped for '
                    f'newer ones, as a pair takes {milliseconds:.0f} ms: use preset fast, downscale or roi, or set '
                    'max_rate to what it can do')
        return Shortfall(Line('behind', text), 'the node keeps up again')


class FailedMatches:
    """Pairs of which few pixels are valid: passed the left-right check and unique.

    Real pairs of Middlebury and KITTI have 65 to 87 % of them, with left and right swapped 12 to 30 %,
    with a quarter of the search range 32 to 60 %, five rows apart 19 to 54 %, unrelated noise 4 to 14 %.
    """

    def __init__(self) -> None:
        self._failed = _Lasting(0.55, 0.5)

    def check(self, shares: Sequence[float], tau_lr: float) -> Shortfall:
        """shares: of valid pixels, 0 .. 1, of the last pairs. tau_lr: the parameter, px; below 1 nothing is said.
        """
        judged = len(shares) >= _FEWEST_CHECKED and tau_lr >= 1
        share = statistics.median(shares) if judged else 1.0
        text = ''
        if self._failed.update(1 - share):
            text = (f'only {share:.0%} of the pixels are valid (60 to 90 % are usual): look whether '
                    'left and right are swapped, the images are rectified, the search range holds what is seen '
                    '(min_disparity, num_disparities), and the lenses are free')
        return Shortfall(Line('left-right check', text), 'most pixels are valid again')
