"""A rosbag2 that is written anew and appears under its name only when it is complete."""
from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Literal

from rosbags.interfaces import Connection, Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer

from .output_place import check_place, put_in_place
from .stereo_messages import TYPES

Storage = Literal['mcap', 'sqlite3']
Compression = Literal['none', 'zstd']
_FOREVER = QosTime(9223372036, 854775807)
RELIABLE = Qos(QosHistory.KEEP_LAST, 10, QosReliability.RELIABLE, QosDurability.VOLATILE, _FOREVER, _FOREVER,
               QosLiveliness.AUTOMATIC, _FOREVER, False)
"""Offered to whoever plays the bag: fits every subscription but latched ones."""


def check_bag_output(path: Path, force: bool) -> None:
    """Refuse, before the work, what could not be written after it.

    Raises ValueError where `path` exists (with `force`: where it is no bag), or its folder is missing or read-only.
    """
    check_place(path, force)
    if not os.access(path.parent, os.W_OK):
        raise ValueError(f'{path}: the folder {path.parent} cannot be written')


@contextlib.contextmanager
def new_bag(path: Path, storage: Storage, compression: Compression, force: bool) -> Iterator[Writer]:
    """A writer of the folder `path`, which is there, whole, once the block ends well, and not at all otherwise.

    Raises ValueError as `check_bag_output`, and OSError where it cannot be written (a full disk).
    """
    check_bag_output(path, force)
    with tempfile.TemporaryDirectory(dir=path.parent, prefix=f'.{path.name}.') as waiting:
        writer = Writer(Path(waiting) / path.name, version=9, storage_plugin=StoragePlugin[storage.upper()])
        if compression == 'zstd':
            # mcap compresses its chunks, as `ros2 bag record` does; sqlite3 knows single messages only.
            mode = CompressionMode.STORAGE if storage == 'mcap' else CompressionMode.MESSAGE
            writer.set_compression(mode, CompressionFormat.ZSTD)
        with writer:
            yield writer
        put_in_place(writer.path, path, force)


def add_topic(writer: Writer, topic: str, message_type: str) -> Connection:
    """A topic of a type of ROS 2 Jazzy, offered as RELIABLE."""
    return writer.add_connection(topic, message_type, typestore=TYPES, offered_qos_profiles=[RELIABLE])
