"""A rosbag2 that is readable at any moment while it grows, and goes on after a kill.

The bag under construction is a folder of its own, a split rosbag2 in mcap. Messages go into a small file that is not
listed yet; once that is closed, metadata.yaml is replaced by one that lists it. So whatever the moment, the files
listed are whole. Small files are joined into large ones, and the folder is renamed at the end.
"""
from __future__ import annotations

import contextlib
import dataclasses
import json
import os
import shutil
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import yaml
from rosbags.interfaces import Qos
from rosbags.typesys.store import Typestore

from svdm_core.files.user_files import METADATA, read_text
from svdm_core.shown import cut

from ..reading.metadata import METADATA_FILE, ROOT, read_metadata
from ..reading.recording import RecordingError, open_recording
from .mcap_storage import BagWriter
from .output_place import put_in_place
from .partial_folder import (
    IN_WORK,
    NEW,
    SEGMENT_SUFFIX,
    STATE_FILE,
    is_bag_file,
    locked_folder,
    partial_path,
    remove_folder,
    remove_marks,
    remove_own,
)

SEGMENT_BYTES = 32 * 2**20
"""What a kill can cost: a small file is closed as soon as it holds this much."""
VOLUME_BYTES = 2**30
"""Size of a file of the finished bag; one file as long as it is not more."""

_STATE = 'svdm_ros'
_DUMPER = getattr(yaml, 'CSafeDumper', yaml.SafeDumper)


class DamagedBagError(ValueError):
    """A bag under construction that no run can go on with."""

    def __init__(self, file: Path, reason: str) -> None:
        super().__init__(f'{file}: damaged ({reason}): --force removes what process_bag wrote in this folder and '
                         'begins anew; or name another output')


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

    def __init__(self, output: Path, topics: Sequence[OutputTopic], force: bool) -> None:
        self._output = output
        self._force = force
        self._folder = partial_path(output)
        self._definitions = [(topic, topic.typestore.generate_msgdef(topic.message_type, ros_version=2)[0],
                              topic.typestore.hash_rihs01(topic.message_type)) for topic in topics]
        self._writer: BagWriter | None = None
        self._connections: dict[str, Any] = {}
        self._bytes = 0
        self._metadata: dict[str, Any] = {}
        self._settings: dict[str, Any] = {}
        self._is_open = True
        self.state: dict[str, Any] = {}

    def start(self, settings: dict[str, Any]) -> None:
        """Go on with what is in the folder, or make it an empty bag.

        Raises ValueError where it was begun with other settings, DamagedBagError where it cannot be gone on with.
        """
        if self._force:
            remove_own(self._folder, ())
        self._settings = settings
        if os.path.lexists(self._folder / METADATA_FILE):
            self._metadata, stored, self.state = read_partial(self._folder)
            _check_same(self._folder, stored, settings)
            if not self._metadata['custom_data']:  # it was complete, up to its name
                self._metadata['custom_data'] = {_STATE: json.dumps(self._stored())}
                self._write_metadata()
            self._remove_unlisted()
        else:
            self._remove_unlisted()
            self._open_segment()
            self._close_segment({})

    def damaged(self, reason: str) -> DamagedBagError:
        """What is raised where the state turns out to be none."""
        return DamagedBagError(self._folder / METADATA_FILE, reason)

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
        self._is_open = False

    def finish(self, add_files: Callable[[Path], None]) -> None:
        """Join what is there and give the bag its name; with `force` a bag of that name is replaced.

        `add_files(folder)` is called before that, when the bag is complete, and may write further files beside it.
        Raises ValueError where something else has come to have the name; the bag stays as it is.
        """
        if self._segments():
            self._join()
        add_files(self._folder)
        # The metadata of the finished bag have no place for the state; a run after a kill finds it here.
        self._replace(STATE_FILE, json.dumps(self._stored()))
        self._metadata['custom_data'] = None
        self._write_metadata()
        put_in_place(self._folder, self._output, self._force)
        self._is_open = False
        remove_marks(self._output)

    def discard(self) -> None:
        """Remove it, with all that this program wrote into it."""
        self.abandon_segment()
        remove_folder(self._folder)

    def leave(self) -> None:
        """Keep what is committed, where the bag has neither been finished nor discarded."""
        if self._is_open:
            self.abandon_segment()

    def _segments(self) -> list[dict[str, Any]]:
        return [file for file in self._metadata['files'] if file['path'].endswith(SEGMENT_SUFFIX)]

    def _volumes(self) -> list[dict[str, Any]]:
        return [file for file in self._metadata['files'] if not file['path'].endswith(SEGMENT_SUFFIX)]

    def _open_segment(self) -> BagWriter:
        if self._writer is None:
            self._writer, self._connections = self._open_writer(f'{IN_WORK}segment')
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
            added = self._closed(writer, f'{number}{SEGMENT_SUFFIX}')
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
        self._metadata['custom_data'] = {_STATE: json.dumps(self._stored())}
        self._write_metadata()
        self._remove_unlisted()

    def _closed(self, writer: BagWriter, name: str) -> dict[str, Any]:
        """Close a writer and give its file a name in the folder; the metadata rosbags wrote for it."""
        writer.close()
        metadata = read_metadata(writer.metapath)
        [file] = metadata['files']
        os.replace(writer.path / file['path'], self._folder / name)
        shutil.rmtree(writer.path)
        file['path'] = name
        return metadata

    def _join(self) -> None:
        """All segments into one volume."""
        writer, _ = self._open_writer(f'{IN_WORK}volume')
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
        self._replace(METADATA_FILE, yaml.dump({ROOT: self._metadata}, Dumper=_DUMPER, sort_keys=False))

    def _replace(self, name: str, text: str) -> None:
        """Replace a file by one that is whole at any moment."""
        temporary = self._folder / f'{name}{NEW}'
        temporary.write_text(text)
        os.replace(temporary, self._folder / name)

    def _stored(self) -> dict[str, Any]:
        return {'settings': self._settings, 'state': self.state}

    def _remove_unlisted(self) -> None:
        """What a kill, a join or an abandoned segment left."""
        kept = [METADATA_FILE, *self._metadata.get('relative_file_paths', ())]
        if not self._metadata.get('custom_data'):
            kept.append(STATE_FILE)
        remove_own(self._folder, kept)


@contextlib.contextmanager
def open_partial(
    output: Path, topics: Sequence[OutputTopic], settings: dict[str, Any], *, force: bool
) -> Iterator[PartialBag]:
    """Begin the bag `output`, or go on with it; `force` begins anew.

    settings: what the messages depend on, as JSON can hold it; another run goes on only where they are equal.
    Leaving without `finish` keeps what is committed. Raises ValueError where the folder is not of this program, where
    another process is at it, where the settings differ, or where it is damaged.
    """
    with locked_folder(output):
        bag = PartialBag(output, topics, force)
        bag.start(settings)
        try:
            yield bag
        finally:
            bag.leave()


def read_partial(folder: Path) -> tuple[dict[str, Any], dict[str, Any], dict[str, Any]]:
    """Metadata, settings and state of a bag under construction; of one that is complete too, whose metadata have none.

    Raises DamagedBagError where any of it is not what this program writes, or a file of the bag cannot be read.
    """
    file = folder / METADATA_FILE
    try:
        metadata = read_metadata(file)
        _check_files(folder, metadata)
        text = (metadata.get('custom_data') or {}).get(_STATE)
        if text is None:
            file = folder / STATE_FILE
            text = read_text(file, METADATA)
            metadata['custom_data'] = None
        stored = json.loads(text)
        settings, state = stored['settings'], stored['state']
        if not isinstance(settings, dict) or not isinstance(state, dict):
            raise TypeError('settings and state are no objects')
        with open_recording(folder) as recording:
            if recording.missing:
                raise RecordingError(recording.missing[0].removeprefix('left out: '))
    except RecordingError as error:
        raise DamagedBagError(folder, cut(str(error).removeprefix(f'{folder}: '))) from None
    except (ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
        reason = f'no {error}' if isinstance(error, KeyError) else str(error).removeprefix(f'{file}: ')
        raise DamagedBagError(file, cut(reason)) from None
    return metadata, settings, state


def _check_files(folder: Path, metadata: dict[str, Any]) -> None:
    """Raise ValueError, KeyError or TypeError where the lists of files and topics are not as this program writes them.
    """
    names = [file['path'] for file in metadata['files']]
    if not names or names != metadata['relative_file_paths'] or not all(
            isinstance(name, str) and is_bag_file(folder / name) for name in names):
        raise ValueError('its list of files is none of process_bag')
    for file in metadata['files']:
        numbers = (file['message_count'], file['starting_time']['nanoseconds_since_epoch'],
                   file['duration']['nanoseconds'])
        if not all(isinstance(number, int) for number in numbers):
            raise ValueError(f'the entry of {file["path"]} has something else than numbers')
    if not all(isinstance(topic['message_count'], int) for topic in metadata['topics_with_message_count']):
        raise ValueError('the counts of the topics are no numbers')


def _give_up(writer: BagWriter) -> None:
    with contextlib.suppress(Exception):  # the disk may be full
        writer.abort()


def _check_same(folder: Path, stored: dict[str, Any], settings: dict[str, Any]) -> None:
    changed = sorted(name for name in {*stored, *settings} if stored.get(name) != settings.get(name))
    if changed:
        raise ValueError(f'{folder} was begun with a different {", ".join(changed)}: give the same again to go on, '
                         '--force to begin anew, or name another output')

