"""Any recording as one stream of messages in order of time: rosbag2 (mcap, sqlite3) and ROS 1, files or folders."""
from __future__ import annotations

import collections
import contextlib
import dataclasses
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

from rosbags.interfaces import Qos
from rosbags.typesys.msg import normalize_msgtype

from svdm_core.shown import cut, shown

from .bag_files import bag_files, opened_files
from .message_types import RecordedTypes, rank_of
from .metadata import BagMetadata
from .storage import LAST_NS, Channel, DamageError, StorageFile, merged, told
from .storage import RecordingError as RecordingError
from .unpacking import ZSTD, unpack_block

_FIRST_STEP_NS = 10**9


@dataclasses.dataclass(frozen=True, slots=True)
class Topic:
    """One topic of a recording. `message_type` is the ROS 2 name, 'sensor_msgs/msg/Image', for ROS 1 bags as well.

    count: messages of it. qos: what its publishers offered, empty where that was not recorded.
    """

    name: str
    message_type: str
    count: int
    qos: tuple[Qos, ...] = ()


@dataclasses.dataclass(frozen=True, slots=True)
class RecordedMessage:
    """One message: `data` as CDR of ROS 2, converted where the recording is of ROS 1; `time_ns` when it was taken."""

    topic: str
    message_type: str
    time_ns: int
    data: bytes


class _File(NamedTuple):
    """A file of the recording, and its channels that are read, by id."""

    path: Path
    storage: StorageFile
    channels: dict[int, Channel]


class Recording:
    """An open recording; `open_recording` makes them.

    topics: by name. start_ns, end_ns: recording time of the first message and just after the last, 0 and 0 if empty.
    typestore: knows all types of the recording, as they are in ROS 2 Jazzy where it has them too.
    notes: lines on what is not read, or not taken from metadata.yaml. missing: lines on files that are left out.
    """

    def __init__(
        self, path: Path, files: Mapping[Path, StorageFile], metadata: BagMetadata | None = None,
        notes: Sequence[str] = (), missing: Sequence[str] = (),
    ) -> None:
        self.path = path
        self.missing = tuple(missing)
        self._types = RecordedTypes(channel for file in files.values() for channel in file.channels)
        self.typestore = self._types.typestore
        self._files, left_out = _readable(files, self._types)
        qos = metadata.qos if metadata else {}
        self.topics = {topic.name: topic for topic in _topics(self._files, qos)}
        told_otherwise = _compared(path, metadata, self.topics) if metadata and not missing else ()
        self.notes = (*notes, *left_out, *told_otherwise)
        filled = [file for file in files.values() if file.end_ns]
        self.start_ns: int = min((file.start_ns for file in filled), default=0)
        self.end_ns: int = max((file.end_ns for file in filled), default=0)

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """The messages of `topics` (None: all) from `start_ns` on and before `stop_ns`, in the order of their time.

        Streamed: no more than some chunks are in memory. Raises RecordingError where the recording is damaged, or
        where a file gives fewer messages than it tells of.
        """
        part = (0 if start_ns is None else start_ns), (LAST_NS + 1 if stop_ns is None else stop_ns)
        chosen = [(file, [one for one in file.channels.values() if topics is None or one.topic in topics])
                  for file in self._files]
        return merged((file.storage.start_ns, partial(self._read, file, channels, *part)) for file, channels in chosen
                      if channels and file.storage.start_ns < part[1] and file.storage.end_ns > part[0])

    def deserialize(self, message: RecordedMessage) -> Any:
        """The message as an object with the fields of its type. Raises RecordingError where it is damaged."""
        with told(self.path):
            return self.typestore.deserialize_cdr(message.data, message.message_type)

    def where(self, topics: Collection[str]) -> str:
        """Where the messages of these topics lie, as the end of a line on a part without any; '' where there are none.
        """
        extent = self._extent(topics)
        if extent is None:
            return ''
        first, last = (time_ns - self.start_ns for time_ns in extent)
        return (f'; they lie from {first / 1e9:.3f} to {last / 1e9:.3f} s after the beginning of the recording: '
                f'--start {start_option(first)} begins with them')

    def _extent(self, topics: Collection[str]) -> tuple[int, int] | None:
        """Times (ns) of the first and of the last message of these topics; None where there is none."""
        first = next(self.messages(topics), None)
        if first is None:
            return None
        step = _FIRST_STEP_NS
        while True:  # back from the end, as reading all of it would take long
            last = collections.deque(self.messages(topics, self.end_ns - step, self.end_ns), maxlen=1)
            if last or self.end_ns - step <= first.time_ns:
                return first.time_ns, last[-1].time_ns if last else first.time_ns
            step *= 4

    def _read(self, file: _File, channels: list[Channel], start_ns: int, stop_ns: int) -> Iterator[RecordedMessage]:
        """The messages of one file; at the end it is seen whether there were as many as it tells."""
        counts: Counter[int] = Counter()
        with told(file.path):
            for time_ns, number, data in file.storage.messages([one.id for one in channels], start_ns, stop_ns):
                channel = file.channels[number]
                counts[number] += 1
                plain = unpack_block(data, 'zstd') if data[:4] == ZSTD else data
                yield RecordedMessage(channel.topic, normalize_msgtype(channel.message_type), time_ns,
                                      self._types.as_ros2(channel, plain))
            if start_ns <= file.storage.start_ns and file.storage.end_ns <= stop_ns:
                _check_counts(channels, counts)


@contextlib.contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Open a .mcap, .db3 or .bag file, one of these as .zstd, or a folder, with metadata.yaml or without.

    Raises RecordingError in one line for anything that is no readable recording. Of several files those that are
    damaged are left out, see Recording.missing.
    """
    if not path.exists():
        raise RecordingError(f'{path}: there is no such file or folder')
    with contextlib.ExitStack() as stack:
        with told(path):
            found = bag_files(path)
            opened, damaged = opened_files(path, found.files, stack)
            if not opened and damaged:
                raise damaged[0]
            missing = [f'left out: {error}' for error in damaged]
            recording = Recording(path, opened, found.metadata, found.notes, missing)
        yield recording


def start_option(after_ns: int) -> str:
    """What --start takes, s, to begin with a message so many ns after the first one, or just before it."""
    for milliseconds in (after_ns // 10**6, after_ns // 10**6 - 1):  # the number that is read may be rounded up
        text = f'{max(milliseconds, 0) / 1000:.3f}'.rstrip('0').rstrip('.')
        if round(float(text) * 1e9) <= after_ns:
            break
    return text


def _check_counts(channels: list[Channel], counts: Counter[int]) -> None:
    for channel in channels:
        if counts[channel.id] < channel.count:
            raise DamageError(f'{counts[channel.id]} of the {channel.count} messages on {cut(channel.topic)} that it '
                              'tells of can be read: its index is damaged, copy it anew, or mend it with '
                              '`mcap recover` or `rosbag reindex`')


def _readable(files: Mapping[Path, StorageFile], types: RecordedTypes) -> tuple[list[_File], list[str]]:
    """The files with the channels that can be read, and lines on the others."""
    readable, lines = [], []
    chosen = _chosen_types(one for file in files.values() for one in file.channels if not types.lacks(one))
    for path, storage in files.items():
        lines += [f'{path}: {line}' for line in storage.left_out]
        lacking = {one.id: reason for one in storage.channels if (reason := types.lacks(one))}
        lines += [f'{path}: left out: {shown(one.topic)}, {one.count} messages of type {shown(one.message_type)}, '
                  f'{lacking[one.id]}' for one in storage.channels if one.id in lacking]
        kept = {one.id: one for one in storage.channels if one.id not in lacking}
        others = [one for one in kept.values() if chosen[one.topic] != normalize_msgtype(one.message_type)]
        lines += [f'{path}: left out: {shown(one.topic)}, {one.count} messages of type {shown(one.message_type)}: the '
                  f'topic is read as {shown(chosen[one.topic])}, as it has several types' for one in others]
        readable.append(_File(path, storage, {key: one for key, one in kept.items() if one not in others}))
    return readable, lines


def _chosen_types(channels: Iterable[Channel]) -> dict[str, str]:
    """The type that each topic is read as: one with messages, one that is used, the first."""
    by_topic: dict[str, list[Channel]] = {}
    for channel in channels:
        by_topic.setdefault(channel.topic, []).append(channel)
    return {topic: normalize_msgtype(min(found, key=lambda one: (not one.count, rank_of(one))).message_type)
            for topic, found in by_topic.items()}


def _topics(files: Sequence[_File], qos: Mapping[str, tuple[Qos, ...]]) -> Iterator[Topic]:
    """By name. qos: by metadata.yaml, which is edited to play a recording with another one."""
    by_name: dict[str, list[Channel]] = {}
    for file in files:
        for channel in file.channels.values():
            by_name.setdefault(channel.topic, []).append(channel)
    for name, channels in sorted(by_name.items()):
        offered = qos.get(name) or tuple(dict.fromkeys(profile for one in channels for profile in one.qos))
        yield Topic(name, normalize_msgtype(channels[0].message_type), sum(one.count for one in channels), offered)


def _compared(path: Path, metadata: BagMetadata, topics: Mapping[str, Topic]) -> Iterator[str]:
    """A line where the files hold other topics than metadata.yaml tells of, or fewer messages of them."""
    told_of = {name for name, count in metadata.counts.items() if count}
    unknown = sorted(told_of - topics.keys())
    if unknown:
        yield (f'{path}: metadata.yaml tells of {len(unknown)} topics that its files do not hold, the first '
               f'{shown(unknown[0])}: what the files hold is read')
    fewer = [topics[name] for name in sorted(told_of & topics.keys()) if topics[name].count < metadata.counts[name]]
    if fewer:
        yield (f'{path}: metadata.yaml tells of {metadata.counts[fewer[0].name]} messages on {cut(fewer[0].name)}, the '
               f'files hold {fewer[0].count}: what the files hold is read')
