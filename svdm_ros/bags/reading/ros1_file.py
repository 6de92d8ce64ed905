"""A .bag file of ROS 1, by way of rosbags."""
from __future__ import annotations

from collections import Counter
from collections.abc import Collection, Iterator
from functools import partial
from pathlib import Path

from rosbags.rosbag1 import Reader
from rosbags.rosbag1.reader import Chunk, Header

from .storage import Channel, DamageError, StoredMessage
from .unpacking import LARGEST_BLOCK, unpack_block

MAGIC = b'#ROSBAG V'
_COMPRESSIONS = {'none': '', 'bz2': 'bz2', 'lz4': 'lz4'}


class _BoundedReader(Reader):
    """Unpacks no more than a chunk declares."""

    def read_chunk(self) -> Chunk:
        """The chunk at the current position of the file."""
        assert self.bio is not None
        begin = self.bio.tell()
        header = Header.read(self.bio)
        self.bio.seek(begin)
        compression = _COMPRESSIONS.get(header.get_string('compression'), '')
        unpack = partial(unpack_block, compression=compression, size=header.get_uint32('size'))
        chunk = super().read_chunk()
        if chunk.datasize > LARGEST_BLOCK:
            raise ValueError(f'a chunk has {chunk.datasize} bytes, at most {LARGEST_BLOCK} are allowed')
        return chunk._replace(decompressor=unpack)


class Ros1File:
    """An open .bag file, see StorageFile. Raises DamageError, or an error of rosbags, where it is none."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.left_out: list[str] = []
        _check_closed(path)
        self._reader = _BoundedReader(path)
        self._reader.open()
        told: Counter[int] = Counter()
        for chunk in self._reader.chunk_infos:
            told.update(chunk.connection_counts)
        self.channels = [
            Channel(one.id, one.topic, one.msgtype, 'ros1', one.msgdef, max(one.msgcount, told[one.id]))
            for one in self._reader.connections]
        is_empty = not any(channel.count for channel in self.channels)
        self.start_ns, self.end_ns = (0, 0) if is_empty else (self._reader.start_time, self._reader.end_time)

    def messages(self, channels: Collection[int], start_ns: int, stop_ns: int) -> Iterator[StoredMessage]:
        """The messages of these channels, from start_ns on and before stop_ns, in order of time."""
        wanted = [one for one in self._reader.connections if one.id in channels]
        if wanted:
            for connection, time_ns, data in self._reader.messages(wanted, start_ns, stop_ns):
                yield StoredMessage(time_ns, connection.id, data)

    def close(self) -> None:
        """Close the file."""
        self._reader.close()


def _check_closed(path: Path) -> None:
    """Raise DamageError where the recorder has not written the index."""
    with path.open('rb') as file:
        if not file.readline(20).startswith(MAGIC):
            raise DamageError('no ROS 1 bag, or an empty one: copy it anew')
        if Header.read(file).get_uint64('index_pos') == 0:
            raise DamageError('the ROS 1 bag was not closed: mend it with `rosbag reindex`')
