"""A rosbag2 that is readable at any moment while it grows, and goes on after a kill.

The bag under construction is a folder of its own, a split rosbag2 in mcap. Messages go into a small file that is not
listed yet; once that is closed, metadata.yaml is replaced by one that lists it. So whatever the moment, the files
listed are whole. Small files are joined into large ones, and the folder is renamed at the end.
"""
from __future__ import annotations

import contextlib
import dataclasses
import fcntl
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, TextIO

import yaml
from rosbags.interfaces import Qos
from rosbags.typesys.store import Typestore

from .mcap_storage import BagWriter

SEGMENT_BYTES = 32 * 2**20
"""What a kill can cost: a small file is closed as soon as it holds this much."""
VOLUME_BYTES = 2**30
"""Size of a file of the finished bag; one file as long as it is not more."""

_METADATA = 'metadata.yaml'
_ROOT = 'rosbag2_bagfile_information'
_STATE = 'svdm_ros'
_LOCK = '.lock'
_SEGMENT_SUFFIX = '.segment.mcap'
_IN_WORK = 'in_work'
_LOADER = getattr(yaml, 'CSafeLoader', yaml.SafeLoader)
_DUMPER = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)


@dataclasses.dataclass(frozen=True, slots=True)
class OutputTopic:
    """A topic of the bag to be: its type as rosbags knows it, and the QoS a player shall offer."""

    name: str
    message_type: str
    typestore: Typestore
    qos: Sequence[Qos] = ()


class PartialBag:
    """The bag under construction in `folder`; `open_partial` makes it. All calls from one thread at a time.

    state: what the last `commit` that reached the disk was given; empty for a new bag.
    """

    def __init__(self, output: Path, topics: Sequence[OutputTopic], lock: TextIO) -> None:
        self._output = output
        self._folder = partial_path(output)
        self._definitions = [(topic, topic.typestore.generate_msgdef(topic.message_type, ros_version=2)[0],
                              topic.typestore.hash_rihs01(topic.message_type)) for topic in topics]
        self._lock = lock
        self._writer: BagWriter | None = None
        self._connections: dict[str, Any] = {}
        self._bytes = 0
        self._metadata: dict[str, Any] = {}
        self.state: dict[str, Any] = {}

    def start(self, settings: dict[str, Any]) -> None:
        """Go on with what is in the folder, or make it an empty bag.

        Raises ValueError where it was begun with other settings.
        """
        if (self._folder / _METADATA).is_file():
            self._metadata = yaml.load((self._folder / _METADATA).read_text(), _LOADER)[_ROOT]
            stored = json.loads(self._metadata['custom_data'][_STATE])
            _check_same(self._folder, stored['settings'], settings)
            self._settings, self.state = settings, stored['state']
            self._remove_unlisted()
        else:
            self._settings = settings
            self._remove_unlisted()
            self._open_segment()
            self._close_segment({})

    def write(self, topic: str, time_ns: int, data: bytes | memoryview) -> None:
        """Add one message. It is there to stay once a `commit` closes the file it is in."""
        writer = self._open_segment()
        writer.write(self._connections[topic], time_ns, data)
        self._bytes += len(data)

    def commit(self, state: dict[str, Any], *, now: bool = False) -> None:
        """All that belongs together is written: close the file in work if it is large enough, or `now`.

        `state` is kept with it, anything JSON can hold.
        """
        if self._bytes >= SEGMENT_BYTES or (now and state != self.state):
            self._open_segment()
            self._close_segment(state)
            if sum((self._folder / file['path']).stat().st_size for file in self._segments()) >= VOLUME_BYTES:
                self._join()

    def abandon_segment(self) -> None:
        """Give up the file in work and close the rest: after an error, or before the process ends."""
        writer, self._writer = self._writer, None
        if writer is not None:
            _give_up(writer)
        with contextlib.suppress(OSError):
            self._remove_unlisted()
        self._lock.close()

    def finish(self, add_files: Callable[[Path], None]) -> None:
        """Join what is there and give the bag its name; a bag of that name is replaced.

        `add_files(folder)` is called before that, when the bag is complete, and may write further files beside it.
        """
        if self._segments():
            self._join()
        add_files(self._folder)
        self._metadata['custom_data'] = None
        self._write_metadata()
        (self._folder / _LOCK).unlink()
        replaced = self._output.with_name(f'{self._output.name}.replaced')
        if self._output.exists():
            self._output.rename(replaced)
        self._folder.rename(self._output)
        if replaced.exists():
            shutil.rmtree(replaced)
        self._lock.close()

    def discard(self) -> None:
        """Remove it, with all that is in it."""
        self.abandon_segment()
        shutil.rmtree(self._folder)

    def _segments(self) -> list[dict[str, Any]]:
        return [file for file in self._metadata['files'] if file['path'].endswith(_SEGMENT_SUFFIX)]

    def _volumes(self) -> list[dict[str, Any]]:
        return [file for file in self._metadata['files'] if not file['path'].endswith(_SEGMENT_SUFFIX)]

    def _open_segment(self) -> BagWriter:
        if self._writer is None:
            self._writer, self._connections = self._open_writer(f'{_IN_WORK}_segment')
            self._bytes = 0
        return self._writer

    def _open_writer(self, name: str) -> tuple[BagWriter, dict[str, Any]]:
        writer = BagWriter(self._folder / name)
        writer.open()
        connections = {
            topic.name: writer.add_connection(topic.name, topic.message_type, msgdef=definition, rihs01=digest,
                                              offered_qos_profiles=topic.qos)
            for topic, definition, digest in self._definitions}
        return writer, connections

    def _close_segment(self, state: dict[str, Any]) -> None:
        writer, self._writer, self._bytes = self._writer, None, 0
        assert writer is not None
        earlier = self._metadata.setdefault('files', [])
        number = 1 + max((int(file['path'].partition('.')[0]) for file in self._segments()), default=-1)
        try:
            added = self._closed(writer, f'{number}{_SEGMENT_SUFFIX}')
        except BaseException:
            _give_up(writer)
            raise
        files = [file for file in earlier if file['message_count']]
        counts = [entry['message_count'] for entry in self._metadata.get('topics_with_message_count', ())]
        self._metadata = added
        self._metadata['files'] = files + added['files']
        for entry, count in zip(added['topics_with_message_count'], counts, strict=False):
            entry['message_count'] += count
        self.state = state
        self._metadata['custom_data'] = {_STATE: json.dumps({'settings': self._settings, 'state': state})}
        self._write_metadata()
        self._remove_unlisted()

    def _closed(self, writer: BagWriter, name: str) -> dict[str, Any]:
        """Close a writer and give its file a name in the folder; the metadata rosbags wrote for it."""
        writer.close()
        metadata: dict[str, Any] = yaml.load(writer.metapath.read_text(), _LOADER)[_ROOT]
        [file] = metadata['files']
        os.replace(writer.path / file['path'], self._folder / name)
        shutil.rmtree(writer.path)
        file['path'] = name
        return metadata

    def _join(self) -> None:
        """All segments into one volume."""
        writer, _ = self._open_writer(f'{_IN_WORK}_volume')
        volumes = self._volumes()
        try:
            for file in self._segments():
                writer.append(self._folder / file['path'])
            joined = self._closed(writer, f'{self._output.name}_{len(volumes)}.mcap')
        except BaseException:
            _give_up(writer)
            raise
        self._metadata['files'] = volumes + joined['files']
        self._write_metadata()
        self._remove_unlisted()

    def _write_metadata(self) -> None:
        files = self._metadata['files']
        filled = [file for file in files if file['message_count']] or files
        starts = [file['starting_time']['nanoseconds_since_epoch'] for file in filled]
        ends = [start + file['duration']['nanoseconds'] for start, file in zip(starts, filled, strict=True)]
        self._metadata['relative_file_paths'] = [file['path'] for file in files]
        self._metadata['starting_time'] = {'nanoseconds_since_epoch': min(starts)}
        self._metadata['duration'] = {'nanoseconds': max(ends) - min(starts)}
        self._metadata['message_count'] = sum(file['message_count'] for file in files)
        temporary = self._folder / f'{_METADATA}.new'
        temporary.write_text(yaml.dump({_ROOT: self._metadata}, Dumper=_DUMPER, sort_keys=False))
        os.replace(temporary, self._folder / _METADATA)

    def _remove_unlisted(self) -> None:
        """What a kill, a join or an abandoned segment left."""
        listed = {_METADATA, _LOCK, *self._metadata.get('relative_file_paths', ())}
        for path in self._folder.iterdir():
            if path.is_dir():
                shutil.rmtree(path)
            elif path.name not in listed:
                path.unlink()


def partial_path(output: Path) -> Path:
    """Where the bag `output` is under construction."""
    return output.with_name(f'{output.name}.partial')


@contextlib.contextmanager
def open_partial(
    output: Path, topics: Sequence[OutputTopic], settings: dict[str, Any], *, force: bool
) -> Iterator[PartialBag]:
    """Begin the bag `output`, or go on with it; `force` begins anew.

    settings: what the messages depend on, as JSON can hold it; another run goes on only where they are equal.
    Leaving without `finish` keeps what is committed. Raises ValueError where another process is at it, or the settings
    differ.
    """
    folder = partial_path(output)
    folder.mkdir(exist_ok=True)
    lock = (folder / _LOCK).open('w')
    try:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(f'{folder}: another process is writing it: wait for it, or name another output') from None
        if force:
            (folder / _METADATA).unlink(missing_ok=True)
        bag = PartialBag(output, topics, lock)
        bag.start(settings)
    except BaseException:
        lock.close()
        raise
    try:
        yield bag
    finally:
        if not lock.closed:
            bag.abandon_segment()


def _give_up(writer: BagWriter) -> None:
    with contextlib.suppress(Exception):  # the disk may be full
        writer.abort()


def _check_same(folder: Path, stored: dict[str, Any], settings: dict[str, Any]) -> None:
    changed = sorted(name for name in {*stored, *settings} if stored.get(name) != settings.get(name))
    if changed:
        raise ValueError(f'{folder} was begun with another {", ".join(changed)}: give the same again to go on, '
                         '--force to begin anew, or name another output')

