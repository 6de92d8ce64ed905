"""A .mcap file of a recording: by its summary where that tells of all its messages, else by a pass over all of it."""
from __future__ import annotations

import struct
from array import array
from collections import Counter
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path
from typing import BinaryIO, Literal, cast

import numpy as np
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

from .mcap_records import (
    CHANNEL,
    CHUNK,
    CHUNK_INDEX,
    DATA_END,
    FOOTER,
    MESSAGE,
    MESSAGE_HEAD,
    SCHEMA,
    STATISTICS,
    Chunk,
    CutOffError,
    McapChannel,
    Record,
    Schema,
    Statistics,
    channel_of,
    check_summary,
    chunk_index_of,
    content_of,
    data_bounds,
    message_head,
    records,
    records_within,
    schema_of,
    statistics_of,
    unpacked_chunk,
)
from .storage import LAST_NS, Channel, DamageError, StoredMessage, left_out_line, merged, qos_of
from .unpacking import LARGEST_BLOCK

_FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros1msg': MessageDefinitionFormat.MSG,
            'ros2idl': MessageDefinitionFormat.IDL, 'omgidl': MessageDefinitionFormat.IDL}
_MOST_HELD = 2 * LARGEST_BLOCK
"""Bytes of the chunks that overlap in time, and are in memory together."""


class McapFile:
    """An open .mcap file, see StorageFile. Raises DamageError or ValueError where it is none."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._schemas: dict[int, Schema] = {}
        self._channels: dict[int, McapChannel] = {}
        self._chunks: list[Chunk] = []
        self._loose = _LooseMessages()
        try:
            with path.open('rb') as file:
                begin, footer, summary = data_bounds(file)
                if not self._reads_summary(file, summary, footer):
                    self._schemas, self._channels = {}, {}  # of a summary that cannot be trusted
                    self._scan(file, begin, footer)
        except CutOffError as error:
            raise DamageError(f'the file is cut off ({error}): mend it with `mcap recover`, or copy it '
                                   'anew') from None
        counts = Counter(self._loose.channels)
        for chunk in self._chunks:
            counts.update(chunk.counts)
        self.channels, self.left_out = self._described(counts)
        filled = [(chunk.start_ns, chunk.end_ns) for chunk in self._chunks if any(chunk.counts.values())]
        filled += [(min(self._loose.times), max(self._loose.times))] if self._loose.times else []
        self.start_ns = min((start for start, _ in filled), default=0)
        self.end_ns = max((end + 1 for _, end in filled), default=0)

    def messages(self, channels: Collection[int], start_ns: int, stop_ns: int) -> Iterator[StoredMessage]:
        """The messages of these channels, from start_ns on and before stop_ns, in order of time."""
        held: list[int] = []
        with self.path.open('rb') as file:
            parts = [
                (chunk.start_ns, partial(_chunk_messages, file, chunk.record, channels, held))
                for chunk in self._chunks
                if chunk.start_ns < stop_ns and chunk.end_ns >= start_ns
                and any(chunk.counts.get(channel) for channel in channels)]
            if self._loose.times:
                parts.append((min(self._loose.times), partial(
                    self._loose.messages, file, channels, start_ns, stop_ns)))
            for message in merged(parts):
                if start_ns <= message.time_ns < stop_ns:
                    yield message

    def close(self) -> None:
        """Nothing is open but while messages are read."""

    def _reads_summary(self, file: BinaryIO, begin: int, end: int) -> bool:
        """Whether there is a whole summary that tells where every message is that it counts, of every channel."""
        if not begin:
            return False
        try:
            check_summary(file, begin, end)
            chunks, statistics = self._summary(file, begin, end)
            is_complete = statistics is not None and self._is_complete(statistics, chunks)
        except (ValueError, struct.error):  # damaged, but the data may be whole
            return False
        if is_complete:
            self._chunks = sorted(chunks, key=lambda chunk: chunk.record.offset)
        return is_complete

    def _summary(self, file: BinaryIO, begin: int, end: int) -> tuple[list[Chunk], Statistics | None]:
        chunks, statistics = [], None
        for record in records(file, begin, end):
            if record.kind == CHUNK_INDEX:
                chunks.append(chunk_index_of(content_of(file, record)))
            elif record.kind == STATISTICS:
                statistics = statistics_of(content_of(file, record))
            elif record.kind in (SCHEMA, CHANNEL):
                self._note(record.kind, content_of(file, record))
        return chunks, statistics

    def _is_complete(self, statistics: Statistics, chunks: list[Chunk]) -> bool:
        counts: Counter[int] = Counter()
        for chunk in chunks:
            counts.update(chunk.counts)
        return (len(chunks) == statistics.chunks and counts.total() == statistics.messages
                and counts == Counter(statistics.counts) and counts.keys() <= self._channels.keys()
                and all(channel.schema in (0, *self._schemas) for channel in self._channels.values()))

    def _scan(self, file: BinaryIO, begin: int, end: int) -> None:
        for record in records(file, begin, end):
            if record.kind in (DATA_END, FOOTER):
                return
            if record.kind == CHUNK:
                self._scan_chunk(file, record)
            elif record.kind == MESSAGE:
                file.seek(record.offset)
                self._loose.add(*message_head(file.read(MESSAGE_HEAD)), record)
            elif record.kind in (SCHEMA, CHANNEL):
                self._note(record.kind, content_of(file, record))

    def _scan_chunk(self, file: BinaryIO, record: Record) -> None:
        start_ns, end_ns, counts = LAST_NS, 0, Counter[int]()
        for kind, content in records_within(unpacked_chunk(file, record)):
            if kind == MESSAGE:
                channel, time_ns = message_head(content)
                start_ns, end_ns = min(start_ns, time_ns), max(end_ns, time_ns)
                counts[channel] += 1
            else:
                self._note(kind, content)
        if counts:
            self._chunks.append(Chunk(start_ns, end_ns, record, dict(counts)))

    def _note(self, kind: int, content: bytes | memoryview) -> None:
        if kind == SCHEMA:
            key, schema = schema_of(content)
            self._schemas[key] = schema
        elif kind == CHANNEL:
            number, channel = channel_of(content)
            self._channels.setdefault(number, channel)

    def _described(self, counts: Counter[int]) -> tuple[list[Channel], list[str]]:
        """The channels that are read, and lines on the others."""
        read, left_out = [], []
        for number, one in sorted(self._channels.items()):
            schema = self._schemas.get(one.schema)
            if schema is None or one.encoding not in ('cdr', 'ros1'):
                encoding = one.encoding if schema else f'{one.encoding} without a type'
                left_out.append(left_out_line(one.topic, encoding, counts[number]))
                continue
            text = schema.text if schema.encoding in _FORMATS else ''
            form = _FORMATS.get(schema.encoding, MessageDefinitionFormat.NONE)
            read.append(Channel(number, one.topic, schema.name, cast(Literal['cdr', 'ros1'], one.encoding),
                                MessageDefinition(form, text), counts[number], qos_of(one.qos)))
        unknown = sum(count for number, count in counts.items() if number not in self._channels)
        if unknown:
            left_out.append(f'left out: {unknown} messages of channels that the file does not name')
        return read, left_out


def _chunk_messages(
    file: BinaryIO, record: Record, channels: Collection[int], held: list[int]
) -> Iterator[StoredMessage]:
    """The messages of these channels in a chunk, in order of time; held: sizes of the chunks that are in memory."""
    data = unpacked_chunk(file, record)
    held.append(len(data))
    if sum(held) > _MOST_HELD:
        raise ValueError(f'its chunks overlap in time, so that more than {_MOST_HELD} bytes were needed at once: write '
                         'it in order of time with `mcap sort`')
    found = [(*message_head(content), content) for kind, content in records_within(data) if kind == MESSAGE]
    for channel, time_ns, content in sorted(found, key=lambda one: one[1]):
        if channel in channels:
            yield StoredMessage(time_ns, channel, bytes(content[MESSAGE_HEAD:]))
    held.remove(len(data))


class _LooseMessages:
    """Where the messages are that are in no chunk; four numbers for each, as there can be millions."""

    def __init__(self) -> None:
        self.channels, self.times, self._offsets, self._sizes = (array('q') for _ in range(4))

    def add(self, channel: int, time_ns: int, record: Record) -> None:
        """One more."""
        for column, value in zip((self.channels, self.times, self._offsets, self._sizes),
                                 (channel, time_ns, record.offset, record.size), strict=True):
            column.append(value)

    def messages(
        self, file: BinaryIO, channels: Collection[int], start_ns: int, stop_ns: int
    ) -> Iterator[StoredMessage]:
        """Those of these channels in order of time; those out of the range may be left out."""
        times = np.asarray(self.times)
        for index in np.argsort(times, kind='stable'):
            if self.channels[index] in channels and start_ns <= times[index] < stop_ns:
                content = content_of(file, Record(MESSAGE, self._offsets[index], self._sizes[index]))
                yield StoredMessage(int(times[index]), self.channels[index], content[MESSAGE_HEAD:])
