"""The records of a .mcap file, by its specification (https://mcap.dev/spec); bytes that do not fit raise ValueError."""
from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from typing import BinaryIO, NamedTuple

from .unpacking import LARGEST_BLOCK, unpack_block

MAGIC = b'\x89MCAP0\r\n'
FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, CHUNK_INDEX, STATISTICS, DATA_END = 2, 3, 4, 5, 6, 8, 11, 15
_HEADER = 1
_HEAD = struct.Struct('<BQ')
_MESSAGE = struct.Struct('<HIQQ')
_CHUNK = struct.Struct('<QQQI')
_CHUNK_INDEX = struct.Struct('<QQQQ')
_STATISTICS = struct.Struct('<QHIIIIQQ')
_COUNT = struct.Struct('<HQ')
_U16, _U32, _U64 = (struct.Struct(f'<{kind}') for kind in 'HIQ')
_FOOTER_SIZE = _HEAD.size + 20
_INDEX_HEAD, _INDEX_ENTRY = 15, 16
"""Bytes of the record that indexes the messages of one channel in a chunk, and of each message in it."""


class CutOffError(ValueError):
    """The file ends before its last record does."""


class Record(NamedTuple):
    """Where a record is in the file: its kind, where its content begins, and the bytes of that."""

    kind: int
    offset: int
    size: int


class Schema(NamedTuple):
    """A message definition."""

    name: str
    encoding: str
    text: str


class McapChannel(NamedTuple):
    """What a channel record tells; offered QoS as YAML."""

    schema: int
    topic: str
    encoding: str
    qos: str


class Chunk(NamedTuple):
    """A chunk of messages: times of the first and the last, where it is, and how many there are of which channel."""

    start_ns: int
    end_ns: int
    record: Record
    counts: dict[int, int]


class Statistics(NamedTuple):
    """What the file tells of itself."""

    messages: int
    chunks: int
    counts: dict[int, int]


class Fields:
    """The fields of a record, one after the other."""

    def __init__(self, data: bytes | memoryview) -> None:
        self.data = memoryview(data)
        self.place = 0

    def numbers(self, layout: struct.Struct) -> tuple[int, ...]:
        """As many as the layout has."""
        values: tuple[int, ...] = layout.unpack_from(self.data, self.place)
        self.place += layout.size
        return values

    def content(self, length: struct.Struct = _U32) -> memoryview:
        """Bytes that come behind their number."""
        [size] = self.numbers(length)
        if size > len(self.data) - self.place:
            raise ValueError(f'a field of {size} bytes in a record of {len(self.data)}')
        self.place += size
        return self.data[self.place - size:self.place]

    def text(self) -> str:
        """UTF-8."""
        return str(self.content(), 'utf-8')


def data_bounds(file: BinaryIO) -> tuple[int, int, int]:
    """Where records of data begin, where the footer does, and where the summary does, 0 for none.

    Raises CutOffError where the file has no end.
    """
    size = file.seek(0, os.SEEK_END)
    file.seek(0)
    if not size or not MAGIC.startswith(file.read(len(MAGIC))[:size]):
        raise CutOffError('it is empty') if not size else ValueError('it does not begin as a .mcap does')
    footer = size - len(MAGIC) - _FOOTER_SIZE
    file.seek(max(footer, 0))
    end = file.read()
    if footer < len(MAGIC) or not end.endswith(MAGIC) or _HEAD.unpack_from(end) != (FOOTER, 20):
        raise CutOffError('it has no end')
    header = next(records(file, len(MAGIC), footer), None)
    if header is None or header.kind != _HEADER:
        raise ValueError('it has no header')
    summary: int = _U64.unpack_from(end, _HEAD.size)[0]
    return header.offset + header.size, footer, summary


def check_summary(file: BinaryIO, begin: int, footer: int) -> None:
    """Raise ValueError where the summary from `begin` to the footer is not as its checksum tells, if it has one."""
    end = footer + _HEAD.size + 2 * _U64.size  # in the footer, where the checksum stands
    file.seek(end)
    [checksum] = _U32.unpack(file.read(_U32.size))
    if begin > footer or (checksum and zlib.crc32(content_of(file, Record(FOOTER, begin, end - begin))) != checksum):
        raise ValueError('the checksum of the summary is wrong')


def records(file: BinaryIO, begin: int, end: int) -> Iterator[Record]:
    """The records between two places of the file."""
    while begin < end:
        file.seek(begin)
        head = file.read(_HEAD.size)
        kind, size = _HEAD.unpack(head)
        begin += _HEAD.size
        if size > end - begin:
            raise CutOffError(f'a record of {size} bytes goes beyond the end')
        yield Record(kind, begin, size)
        begin += size


def content_of(file: BinaryIO, record: Record) -> bytes:
    """The content of a record, in memory."""
    if not 0 <= record.size <= LARGEST_BLOCK:
        raise ValueError(f'a record has {record.size} bytes, at most {LARGEST_BLOCK} are allowed')
    file.seek(record.offset)
    data = file.read(record.size)
    if len(data) != record.size:
        raise CutOffError(f'a record of {record.size} bytes goes beyond the end')
    return data


def unpacked_chunk(file: BinaryIO, record: Record) -> bytes:
    """The records in a chunk."""
    fields = Fields(content_of(file, record))
    *_, size, checksum = fields.numbers(_CHUNK)
    compression = fields.text()
    data = unpack_block(bytes(fields.content(_U64)), compression, size)
    if checksum and zlib.crc32(data) != checksum:
        raise ValueError('the checksum of a chunk is wrong')
    return data


def records_within(data: bytes) -> Iterator[tuple[int, memoryview]]:
    """Kind and content of the records in a chunk."""
    fields = Fields(data)
    while fields.place < len(data):
        kind = data[fields.place]
        fields.place += 1
        yield kind, fields.content(_U64)


def message_head(content: bytes | memoryview) -> tuple[int, int]:
    """Channel and recording time (ns) of a message; what it holds comes after `MESSAGE_HEAD` bytes."""
    channel, _, time_ns, _ = _MESSAGE.unpack_from(content)
    if time_ns >= 2**63:
        raise ValueError(f'a message has the time {time_ns} ns')
    return channel, time_ns


MESSAGE_HEAD = _MESSAGE.size


def schema_of(content: bytes | memoryview) -> tuple[int, Schema]:
    """Id and content of a schema."""
    fields = Fields(content)
    [key] = fields.numbers(_U16)
    return key, Schema(fields.text(), fields.text(), fields.text())


def channel_of(content: bytes | memoryview) -> tuple[int, McapChannel]:
    """Id and content of a channel."""
    fields = Fields(content)
    [key], [schema] = fields.numbers(_U16), fields.numbers(_U16)
    topic, encoding, told = fields.text(), fields.text(), Fields(fields.content())
    metadata = {}
    while told.place < len(told.data):
        name = told.text()
        metadata[name] = told.text()
    return key, McapChannel(schema, topic, encoding, metadata.get('offered_qos_profiles', ''))


def chunk_index_of(content: bytes | memoryview) -> Chunk:
    """A chunk by what the summary tells of it; as many messages as the index of each channel has."""
    fields = Fields(content)
    start_ns, end_ns, offset, length = fields.numbers(_CHUNK_INDEX)
    places = sorted((place, channel) for channel, place in _COUNT.iter_unpack(fields.content()))
    [index_length] = fields.numbers(_U64)
    ends = [place for place, _ in places[1:]] + [offset + length + index_length]
    counts = {channel: max(end - place - _INDEX_HEAD, 0) // _INDEX_ENTRY
              for (place, channel), end in zip(places, ends, strict=False)}
    return Chunk(start_ns, end_ns, Record(CHUNK, offset + _HEAD.size, length - _HEAD.size), counts)


def statistics_of(content: bytes | memoryview) -> Statistics:
    """How many messages and chunks there are, and how many messages of each channel."""
    fields = Fields(content)
    messages, _, _, _, _, chunks, _, _ = fields.numbers(_STATISTICS)
    return Statistics(messages, chunks, dict(_COUNT.iter_unpack(fields.content())))
