"""Pairs left and right images by stamp. Free of ROS: stamps are integers (ns), an image is any object."""
from __future__ import annotations

import bisect
import dataclasses
import math
from collections import deque
from collections.abc import Iterator
from typing import Literal

SideName = Literal['left', 'right']

JUMP_BACK_NS = 100_000_000
"""A stamp this much older than the newest of its side means that time went back (a looping bag); less is reordering,
unless the stamp was there before: a bag shorter than this repeats its stamps, and no image comes late twice."""
_STAMPS_KEPT = 256
_GAPS_KEPT = 8


@dataclasses.dataclass(frozen=True, slots=True)
class Pair[Image]:
    """Two images of one moment; `gap_ns` is the distance of their stamps."""

    left: Image
    right: Image
    gap_ns: int


class _Side[Image]:
    """The images of one camera that wait for their partner, by stamp."""

    def __init__(self) -> None:
        self.stamps: list[int] = []
        self.images: list[Image] = []
        self.sizes: list[int] = []
        self.newest: int | None = None
        self.paired_up_to: int | None = None
        self.unpaired = 0
        self.beyond_memory = 0
        self._gaps: deque[int] = deque(maxlen=_GAPS_KEPT)
        self._seen: deque[int] = deque(maxlen=_STAMPS_KEPT)

    @property
    def period(self) -> int | None:
        """The smallest of the last gaps between stamps (ns), None before there are two stamps."""
        return min(self._gaps, default=None)

    def goes_back(self, stamp: int) -> bool:
        if self.newest is None or stamp >= self.newest:
            return False
        return self.newest - stamp > JUMP_BACK_NS or stamp in self._seen

    def restart(self) -> None:
        """Forget the time before a jump, and the images with it."""
        self.drop(len(self.stamps))
        self._gaps.clear()
        self._seen.clear()
        self.newest = self.paired_up_to = None

    def insert(self, stamp: int, image: Image, size: int) -> None:
        """size: bytes of the image."""
        self._seen.append(stamp)
        if self.newest is None or stamp > self.newest:
            if self.newest is not None:
                self._gaps.append(stamp - self.newest)
            self.newest = stamp
        if self.paired_up_to is not None and stamp < self.paired_up_to:
            self.unpaired += 1  # too late: a later pair is out
            return
        position = bisect.bisect_left(self.stamps, stamp)
        if position < len(self.stamps) and self.stamps[position] == stamp:
            self.images[position], self.sizes[position] = image, size  # a stamp sent twice: the newer image counts
            self.unpaired += 1
            return
        self.stamps.insert(position, stamp)
        self.images.insert(position, image)
        self.sizes.insert(position, size)

    def limit(self, count: int, most_bytes: float) -> None:
        """Drop the oldest beyond `count` images, then the oldest beyond `most_bytes`, but never the last one."""
        self.drop(len(self.stamps) - count)
        while len(self.sizes) > 1 and sum(self.sizes) > most_bytes:
            self.beyond_memory += 1
            self._forget(1)

    def nearest(self, stamp: int) -> int | None:
        """Position of the stamp nearest to `stamp`, the earlier one of two; None where nothing waits."""
        if not self.stamps:
            return None
        after = bisect.bisect_left(self.stamps, stamp)
        around = [position for position in (after - 1, after) if 0 <= position < len(self.stamps)]
        return min(around, key=lambda position: abs(self.stamps[position] - stamp))

    def take(self, position: int) -> Image:
        """Remove and return one image; older ones can no longer be paired in order and are dropped."""
        self.paired_up_to = self.stamps[position]
        self.drop(position)
        image = self.images[0]
        self._forget(1)
        return image

    def drop(self, count: int) -> None:
        """Drop the `count` oldest as unpaired."""
        if count > 0:
            self.unpaired += count
            self._forget(count)

    def _forget(self, count: int) -> None:
        del self.stamps[:count], self.images[:count], self.sizes[:count]


class StereoPairer[Image]:
    """Pairs the nearest stamps that are at most `tolerance_ns` apart; keeps at most `queue_size` images a side,
    and of several no more than `most_bytes` bytes a side: the oldest go.

    Pairs come out in order of time and each image is used at most once. A pair comes out as soon as no image still to
    come can be a nearer partner: at once where the tolerance is below half the frame period, and with equal stamps.
    When the stamps of a side jump back, what was queued before the jump is paired as far as it can be, and dropped.
    `tolerance_ns`, `queue_size` and `most_bytes` may be assigned at any time. `jumps` counts the jumps.
    """

    def __init__(self, tolerance_ns: int = 0, queue_size: int = 10, most_bytes: float = math.inf) -> None:
        self.tolerance_ns = tolerance_ns
        self.queue_size = queue_size
        self.most_bytes = most_bytes
        self.jumps = 0
        self._left: _Side[Image] = _Side()
        self._right: _Side[Image] = _Side()
        self._closest_gap_ns: int | None = None

    @property
    def unpaired(self) -> dict[SideName, int]:
        """Images dropped for want of a partner, a side."""
        return {'left': self._left.unpaired, 'right': self._right.unpaired}

    @property
    def beyond_memory(self) -> dict[SideName, int]:
        """Images dropped as more than `most_bytes` waited, a side."""
        return {'left': self._left.beyond_memory, 'right': self._right.beyond_memory}

    @property
    def waiting(self) -> dict[SideName, int]:
        """Images in the queues, a side."""
        return {'left': len(self._left.stamps), 'right': len(self._right.stamps)}

    def take_closest_gap(self) -> int | None:
        """The smallest distance (ns) between a left and a right stamp since the last call; None if none met."""
        gap, self._closest_gap_ns = self._closest_gap_ns, None
        return gap

    def add(self, side: SideName, stamp_ns: int, image: Image, size: int = 0) -> list[Pair[Image]]:
        """Take in one image of `size` bytes and return the pairs that are now certain, oldest first."""
        own, other = (self._left, self._right) if side == 'left' else (self._right, self._left)
        pairs = []
        if own.newest is not None and own.goes_back(stamp_ns):
            pairs = self.flush()
            self._restart(own, other, stamp_ns, own.newest)
        self._note_gap(other, stamp_ns)
        own.insert(stamp_ns, image, size)
        own.limit(self.queue_size, self.most_bytes)
        return pairs + list(self._settled_pairs(at_end=False))

    def flush(self) -> list[Pair[Image]]:
        """The pairs among the images that wait, oldest first: for the end of a recording, when no nearer one can come.

        The images left over go on waiting.
        """
        return list(self._settled_pairs(at_end=True))

    def _restart(self, own: _Side[Image], other: _Side[Image], now: int, before: int) -> None:
        """Drop what is older than the jump; the other side may have jumped first, its new images stay."""
        self.jumps += 1
        own.restart()
        if other.newest is not None and other.newest > (now + before) // 2:
            other.restart()

    def _note_gap(self, other: _Side[Image], stamp: int) -> None:
        position = other.nearest(stamp)
        if position is not None:
            gap = abs(other.stamps[position] - stamp)
            self._closest_gap_ns = gap if self._closest_gap_ns is None else min(gap, self._closest_gap_ns)

    def _settled_pairs(self, *, at_end: bool) -> Iterator[Pair[Image]]:
        while (found := self._first_pair()) is not None:
            left, right = found
            left_stamp, right_stamp = self._left.stamps[left], self._right.stamps[right]
            if not at_end and not self._is_settled(left_stamp, right_stamp):
                return
            yield Pair(self._left.take(left), self._right.take(right), abs(left_stamp - right_stamp))

    def _first_pair(self) -> tuple[int, int] | None:
        """Positions of the oldest two images that are each other's nearest and within the tolerance."""
        for left, stamp in enumerate(self._left.stamps):
            right = self._right.nearest(stamp)
            if right is None or abs(self._right.stamps[right] - stamp) > self.tolerance_ns:
                continue
            if self._left.nearest(self._right.stamps[right]) == left:
                return left, right
        return None

    def _is_settled(self, left_stamp: int, right_stamp: int) -> bool:
        """Whether no image to come is nearer: only the side that is earlier can still send a nearer one.

        Without this a single lost image would shift a too generous tolerance to pairs one period apart, for good.
        """
        earlier = self._left if left_stamp <= right_stamp else self._right
        later_stamp = max(left_stamp, right_stamp)
        gap = abs(left_stamp - right_stamp)
        if earlier.newest is not None and earlier.newest >= later_stamp:
            return True
        return earlier.period is None or earlier.period >= 2 * gap
