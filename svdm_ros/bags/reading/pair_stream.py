"""A recording as a stream of stereo pairs, complete and in order, and of the messages that are copied."""
from __future__ import annotations

import collections
import contextlib
import dataclasses
from collections.abc import Iterator
from typing import Any

from ...frames.stereo_pairing import Pair, SideName, StereoPairer
from .recorded_frames import ByStamp, CameraInfos, stamp_ns
from .recording import RecordedMessage, Recording, RecordingError
from .stereo_topics import StereoTopics

WAITING_BYTES = 512 * 2**20
"""What the images of one side that wait for their partner may take."""
_FEWEST_WAITING = 16
_PATIENCE_NS = 100_000_000
"""How much later than its images a camera_info, or a ground truth, of the same stamp may have been recorded."""


@dataclasses.dataclass(frozen=True, slots=True)
class TimedImage:
    """A deserialized Image or CompressedImage, and when it was recorded, ns."""

    message: Any
    time_ns: int


@dataclasses.dataclass(frozen=True, slots=True)
class RecordedPair:
    """Two images of one moment with the camera_info that is valid then, and the true disparity where there is one."""

    left: TimedImage
    right: TimedImage
    left_info: Any | None
    right_info: Any | None
    ground_truth: Any | None

    @property
    def time_ns(self) -> int:
        """When the left image was recorded."""
        return self.left.time_ns


@dataclasses.dataclass(slots=True)
class PairingCounts:
    """Complete once the stream has come to its end. closest_gap_ns: of stamps left and right, where any are unpaired.
    """

    images: dict[SideName, int] = dataclasses.field(default_factory=lambda: {'left': 0, 'right': 0})
    pairs: int = 0
    unpaired: dict[SideName, int] = dataclasses.field(default_factory=lambda: {'left': 0, 'right': 0})
    jumps: int = 0
    closest_gap_ns: int | None = None


class PairStream:
    """Iterating gives RecordedPair and, for the topics in `copied`, RecordedMessage; the same ones every time.

    recording: where they come from. infos: camera_info to use in place of the recorded ones, (left, right).
    """

    def __init__(
        self, recording: Recording, topics: StereoTopics, tolerance_ns: int, *, copied: frozenset[str],
        start_ns: int, stop_ns: int, infos: tuple[Any, Any] | None = None,
    ) -> None:
        self.counts = PairingCounts()
        self.recording = recording
        self._topics = topics
        self._copied = copied
        self._range = start_ns, stop_ns
        self._tolerance_ns = tolerance_ns
        self._pairer: StereoPairer[TimedImage] = StereoPairer(tolerance_ns)
        self._waiting: collections.deque[Pair[TimedImage]] = collections.deque()
        self._given = infos
        self._infos = {name: CameraInfos(self._first(name)) for name in topics.infos}
        self._truths: ByStamp[Any] = ByStamp(WAITING_BYTES)

    def __iter__(self) -> Iterator[RecordedPair | RecordedMessage]:
        topics = self._topics
        truths = {topics.ground_truth} if topics.ground_truth else set()
        wanted = {topics.left, topics.right, *topics.infos} | truths | self._copied
        sides: dict[str, SideName] = {topics.left: 'left', topics.right: 'right'}
        for message in self.recording.messages(wanted, *self._range):
            yield from self._released(message.time_ns)
            if message.topic in self._copied:
                yield message
            if message.topic in sides:
                self._waiting.extend(self._add_both(message) if topics.together
                                     else self._add(sides[message.topic], message))
            elif message.topic in self._infos:
                info = self.recording.deserialize(message)
                self._infos[message.topic].add(stamp_ns(info), info, message.data)
            elif message.topic == topics.ground_truth:
                truth = self.recording.deserialize(message)
                self._truths.add(stamp_ns(truth), truth, len(message.data))
        self._waiting.extend(self._pairer.flush())
        yield from self._released(None)
        self._count()

    def sampled(self, most: int) -> Iterator[RecordedPair]:
        """Up to `most` of its pairs, evenly over the time, without ground truth; the same ones every time.

        What lies between is not read: a pair without a camera_info of its stamp has the first of the recording. Parts
        that are damaged are left out.
        """
        start, stop = self._range[0], min(self._range[1], self.recording.end_ns)
        topics = dataclasses.replace(self._topics, ground_truth=None)
        last = -1
        for begin in (start + (stop - start) * number // most for number in range(most)):
            if begin <= last:
                continue
            part = PairStream(self.recording, topics, self._tolerance_ns, copied=frozenset(), start_ns=begin,
                              stop_ns=self._range[1], infos=self._given)
            with contextlib.suppress(RecordingError):
                for pair in part:
                    if isinstance(pair, RecordedPair) and pair.time_ns > last:
                        last = pair.time_ns
                        yield pair
                        break

    def _first(self, topic: str) -> Any | None:
        message = next(self.recording.messages([topic]), None)
        return self.recording.deserialize(message) if message else None

    def _add(self, side: SideName, message: RecordedMessage) -> list[Pair[TimedImage]]:
        self.counts.images[side] += 1
        # Offline an image may wait as long as there is memory for it: no pair is lost to a queue.
        self._pairer.queue_size = max(_FEWEST_WAITING, WAITING_BYTES // max(len(message.data), 1))
        image = self.recording.deserialize(message)
        return self._pairer.add(side, stamp_ns(image), TimedImage(image, message.time_ns))

    def _add_both(self, message: RecordedMessage) -> list[Pair[TimedImage]]:
        """An image that holds both views is a pair by itself."""
        for side in self.counts.images:
            self.counts.images[side] += 1
        image = TimedImage(self.recording.deserialize(message), message.time_ns)
        return [Pair(image, image, 0)]

    def _released(self, now_ns: int | None) -> Iterator[RecordedPair]:
        """The pairs that have all that belongs to them, or have waited for it in vain; at the end (None) all."""
        while self._waiting:
            pair = self._waiting[0]
            due = max(pair.left.time_ns, pair.right.time_ns) + _PATIENCE_NS
            if now_ns is not None and now_ns <= due and not self._is_complete(pair):
                return
            self.counts.pairs += 1
            yield self._recorded(self._waiting.popleft())

    def _is_complete(self, pair: Pair[TimedImage]) -> bool:
        left, right = stamp_ns(pair.left.message), stamp_ns(pair.right.message)
        topics = self._topics
        waited_for = [(topics.left_info, left), (topics.right_info, right)]
        return (all(self._infos[name].has(stamp) for name, stamp in waited_for if name)
                and (topics.ground_truth is None or self._truths.has(left)))

    def _recorded(self, pair: Pair[TimedImage]) -> RecordedPair:
        left, right = stamp_ns(pair.left.message), stamp_ns(pair.right.message)
        infos = self._given or (self._info(self._topics.left_info, left), self._info(self._topics.right_info, right))
        return RecordedPair(pair.left, pair.right, *infos, self._truths.exact(left))

    def _info(self, topic: str | None, stamp: int) -> Any | None:
        return self._infos[topic].valid_at(stamp) if topic else None

    def _count(self) -> None:
        counts, pairer = self.counts, self._pairer
        counts.jumps = pairer.jumps
        counts.closest_gap_ns = pairer.take_closest_gap()
        for side in counts.unpaired:
            counts.unpaired[side] = pairer.unpaired[side] + pairer.waiting[side]
