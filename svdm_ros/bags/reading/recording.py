"""Any recording as one stream of messages in order of time: rosbag2 (mcap, sqlite3) and ROS 1, files or folders."""
from __future__ import annotations

import contextlib
import dataclasses
import re
import shutil
import sys
import tempfile
from collections.abc import Callable, Collection, Iterator
from pathlib import Path
from typing import Any

from rosbags.convert.converter import generate_message_converter
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Connection, Qos
from rosbags.typesys import Stores, get_typestore
from rosbags.typesys.store import Typestore

from svdm_core.files.user_files import Limits, RefusedFileError, check_regular
from svdm_core.shown import cut

from .metadata import check_metadata

_STORAGES = ('.mcap', '.db3')
_SUFFIXES = (*_STORAGES, '.bag')
_PACKED = '.zstd'


class RecordingError(ValueError):
    """A recording that cannot be read, at all or from some point on. The text is one line that says what to do."""


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


class Recording:
    """An open recording; `open_recording` makes them.

    topics: by name. start_ns, end_ns: recording time of the first message and just after the last, 0 and 0 if empty.
    typestore: knows all types of the recording, as they are in ROS 2 Jazzy where it has them too.
    """

    def __init__(self, path: Path, reader: AnyReader) -> None:
        self.path = path
        self.topics = {topic.name: topic for topic in _topics(reader)}
        empty = reader.message_count == 0
        self.start_ns: int = 0 if empty else reader.start_time
        self.end_ns: int = 0 if empty else reader.end_time
        self.typestore = _typestore(reader)
        self._reader = reader
        self._converters: dict[str, Callable[[bytes], memoryview]] = {}

    def messages(
        self, topics: Collection[str] | None = None, start_ns: int | None = None, stop_ns: int | None = None
    ) -> Iterator[RecordedMessage]:
        """The messages of `topics` (None: all) from `start_ns` on and before `stop_ns`, in the order of their time.

        Streamed: no more than some chunks are in memory. Raises RecordingError where the recording is damaged.
        """
        connections = [one for one in self._reader.connections if topics is None or one.topic in topics]
        if not connections:
            return
        with _told(self.path):
            for connection, time_ns, data in self._reader.messages(connections, start_ns, stop_ns):
                yield RecordedMessage(connection.topic, connection.msgtype, time_ns, self._ros2(connection, data))

    def deserialize(self, message: RecordedMessage) -> Any:
        """The message as an object with the fields of its type. Raises RecordingError where it is damaged."""
        with _told(self.path):
            return self.typestore.deserialize_cdr(message.data, message.message_type)

    def _ros2(self, connection: Connection, data: bytes) -> bytes:
        if self._reader.is2:
            return data
        name = connection.msgtype
        if name not in self._converters:
            with contextlib.redirect_stdout(None):  # it prints what it converts
                self._converters[name] = generate_message_converter(
                    self._reader.typestore, self.typestore, name, name, {}, src_is2=False, dst_is2=True)
        return bytes(self._converters[name](data))


@contextlib.contextmanager
def open_recording(path: Path) -> Iterator[Recording]:
    """Open a .mcap, .db3 or .bag file, one of these as .zstd, or a folder, with metadata.yaml or without.

    Raises RecordingError in one line for anything that is no readable recording.
    """
    if not path.exists():
        raise RecordingError(f'{path}: there is no such file or folder')
    with contextlib.ExitStack() as stack:
        with _told(path):
            files = _unpacked(_files(path), stack)
            reader = stack.enter_context(AnyReader(files, default_typestore=get_typestore(Stores.ROS2_JAZZY)))
            recording = Recording(path, reader)
        yield recording


def _typestore(reader: AnyReader) -> Typestore:
    """A ROS 2 recording is read by its own definitions; ROS 1 has other ones of the same names."""
    own, jazzy = reader.typestore.fielddefs, get_typestore(Stores.ROS2_JAZZY)
    if all(jazzy.fielddefs.get(name) == definition for name, definition in own.items()):
        return jazzy
    store = get_typestore(Stores.EMPTY)
    store.register({**jazzy.fielddefs, **own} if reader.is2 else {**own, **jazzy.fielddefs})
    return store


def _topics(reader: AnyReader) -> Iterator[Topic]:
    by_name: dict[str, list[Connection]] = {}
    for connection in reader.connections:
        by_name.setdefault(connection.topic, []).append(connection)
    for name, connections in sorted(by_name.items()):
        first = connections[0]
        qos = tuple(profile for one in connections for profile in getattr(one.ext, 'offered_qos_profiles', ()))
        # Two files of one split bag that lost its metadata.yaml have a connection each, counted each.
        yield Topic(name, first.msgtype, sum(one.msgcount for one in connections), qos)


def _files(path: Path) -> list[Path]:
    """What rosbags is to open: the file, the folder, or the files of a folder that lost its metadata.yaml."""
    if not path.is_dir():
        check_regular(path, Limits(sys.maxsize))
        if _storage_suffix(path) not in _SUFFIXES:
            raise RecordingError(f'{path}: the suffix {path.suffix!r} is none of a recording: {", ".join(_SUFFIXES)}, '
                                 f'with {_PACKED} behind it or without, or the folder of a rosbag2')
        return [path]
    if (path / 'metadata.yaml').exists():
        check_metadata(path / 'metadata.yaml')
        return [path]
    for storage in _STORAGES:
        files = sorted((file for file in path.iterdir() if _storage_suffix(file) == storage), key=_number)
        if files:
            for file in files:
                check_regular(file, Limits(sys.maxsize))
            return files
    raise RecordingError(f'{path}: no recording in this folder: neither metadata.yaml nor {" nor ".join(_STORAGES)}')


def _storage_suffix(path: Path) -> str:
    return Path(path.stem).suffix if path.suffix == _PACKED else path.suffix


def _number(path: Path) -> tuple[list[int], str]:
    """bag_2.mcap before bag_10.mcap."""
    return [int(digits) for digits in re.findall(r'\d+', path.name)], path.name


def _unpacked(files: list[Path], stack: contextlib.ExitStack) -> list[Path]:
    """Files that are compressed as a whole, decompressed into a folder that goes when `stack` is closed."""
    if not any(file.suffix == _PACKED for file in files):
        return files
    folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='svdm_bag_')))
    return [_unpack(file, folder / file.stem) if file.suffix == _PACKED else file for file in files]


def _unpack(packed: Path, target: Path) -> Path:
    try:
        from compression import zstd  # type: ignore[import-not-found, unused-ignore]  # Python 3.14
    except ImportError:
        from backports import zstd  # comes with rosbags
    with zstd.open(packed, 'rb') as source, target.open('wb') as file:
        shutil.copyfileobj(source, file)
    return target


@contextlib.contextmanager
def _told(path: Path) -> Iterator[None]:
    """Whatever the parsers raise on bytes that are no recording, as one line."""
    try:
        yield
    except RecordingError:
        raise
    except RefusedFileError as error:
        raise RecordingError(str(error)) from None
    except PermissionError:
        raise RecordingError(f'{path}: no permission to read it') from None
    except Exception as error:  # parsers fed with damaged bytes raise anything, TypeError and struct.error included
        raise RecordingError(f'{path}: {_explained(error)}') from error


def _explained(error: Exception) -> str:
    """What is wrong, and what to do about it."""
    text = ' '.join(str(error).split()).rstrip('.') or type(error).__name__
    shown = cut(text)
    if 'end magic' in text or 'Truncated' in text or 'footer' in text or 'seems to be empty' in text:
        return f'the file is cut off ({shown}): mend it with `mcap recover`, or copy it anew'
    if 'not in timestamp order' in text:
        return f'{shown}: `mcap recover` or `ros2 bag convert` writes an indexed one'
    if 'not indexed' in text:
        return 'the ROS 1 bag was not closed: mend it with `rosbag reindex`'
    if 'files are missing' in text:
        return f'{shown}: metadata.yaml names them; copy them too, or remove metadata.yaml'
    if 'not supported' in text:
        return shown
    return f'damaged or no recording ({shown})'
