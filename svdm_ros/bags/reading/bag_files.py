"""Which files a recording is of, and each of them opened by its storage."""
from __future__ import annotations

import contextlib
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import NamedTuple

from svdm_core.files.user_files import Limits, check_regular
from svdm_core.shown import shown

from . import mcap_file, mcap_records, ros1_file, sqlite_file
from .metadata import METADATA_FILE, BagMetadata, UnusableMetadataError, bag_metadata
from .storage import DamagedFileError, DamageError, RecordingError, StorageFile, told
from .unpacking import PACKED_SUFFIX, unpacked_files

_STORAGES = ('.mcap', '.db3')
_ROS1 = '.bag'
_SUFFIXES = (*_STORAGES, _ROS1)
_ACTIVE = '.active'
_READERS: dict[str, Callable[[Path], StorageFile]] = {
    '.mcap': mcap_file.McapFile, '.db3': sqlite_file.SqliteFile, _ROS1: ros1_file.Ros1File}
_MAGIC = {mcap_records.MAGIC: '.mcap', sqlite_file.MAGIC: '.db3', ros1_file.MAGIC: _ROS1}


class BagFiles(NamedTuple):
    """The files of a recording in their order, what their metadata.yaml tells, and lines on what is wrong with that."""

    files: list[Path]
    metadata: BagMetadata | None = None
    notes: tuple[str, ...] = ()


def bag_files(path: Path) -> BagFiles:
    """The file, or the files of a folder: those that metadata.yaml names, or all where there is none that can be used.

    Raises RecordingError or RefusedFileError where there are none.
    """
    if not path.is_dir():
        return BagFiles([_checked_file(path)])
    metadata = path / METADATA_FILE
    if not metadata.exists():
        return BagFiles(_found_files(path, f'{path}: no recording in this folder: neither metadata.yaml nor .mcap nor '
                                           '.db3'))
    try:
        usable = bag_metadata(metadata)
    except UnusableMetadataError as error:
        files = _found_files(path, f'{error}; and there is no .mcap or .db3 beside it')
        return BagFiles(files, None, (f'{error}: read without it',))
    files = [path / name for name in usable.files]
    if missing := [file.name for file in files if not file.exists()]:
        raise RecordingError(f'{path}: {len(missing)} of its files are missing, the first {missing[0]}: metadata.yaml '
                             'names them; copy them too, or remove metadata.yaml')
    return BagFiles(files, usable, tuple(_unnamed(path, usable)))


def _unnamed(folder: Path, metadata: BagMetadata) -> Iterator[str]:
    """A line where there are recording files that metadata.yaml does not name."""
    others = sorted((file for file in folder.iterdir() if _storage_suffix(file) in _SUFFIXES
                     and file.name not in metadata.files), key=_number)
    if others:
        yield (f'{folder}: {len(others)} files beside metadata.yaml are not read, the first {shown(others[0].name)}: '
               'it does not name them; to read all files, remove metadata.yaml')


def _checked_file(path: Path) -> Path:
    check_regular(path, Limits(sys.maxsize))
    if path.suffix == _ACTIVE and Path(path.stem).suffix == _ROS1:
        raise RecordingError(f'{path}: its recorder has not closed it: mend it with `rosbag reindex`, then rename it '
                             f'to {path.stem}')
    if _storage_suffix(path) not in _SUFFIXES:
        raise RecordingError(f'{path}: the suffix {path.suffix!r} is none of a recording: {", ".join(_SUFFIXES)}, '
                             f'with {PACKED_SUFFIX} behind it or without, or the folder of a rosbag2')
    return path


def _found_files(folder: Path, otherwise: str) -> list[Path]:
    by_storage: dict[str, list[Path]] = {}
    for file in sorted(folder.iterdir(), key=_number):
        suffix = _storage_suffix(file)
        if suffix in _SUFFIXES or file.name.endswith(f'{_ROS1}{_ACTIVE}'):
            by_storage.setdefault(suffix if suffix in _STORAGES else _ROS1, []).append(file)
    found = [storage for storage in _STORAGES if storage in by_storage]
    if len(found) > 1:
        raise RecordingError(f'{folder}: it holds {" and ".join(found)} files and no usable metadata.yaml, so which of '
                             'them are the recording is not known: give one of the files, or a folder of one kind')
    if not found and _ROS1 in by_storage:
        raise RecordingError(f'{folder}: a folder of {len(by_storage[_ROS1])} ROS 1 bags, the first '
                             f'{by_storage[_ROS1][0].name}: give the files, one or several')
    if not found:
        raise RecordingError(otherwise)
    for file in by_storage[found[0]]:
        check_regular(file, Limits(sys.maxsize))
    return by_storage[found[0]]


def _storage_suffix(path: Path) -> str:
    return Path(path.stem).suffix if path.suffix == PACKED_SUFFIX else path.suffix


def _number(path: Path) -> tuple[list[int], str]:
    """bag_2.mcap before bag_10.mcap."""
    return [int(digits) for digits in re.findall(r'\d+', path.name)], path.name


def opened_files(
    path: Path, files: list[Path], stack: contextlib.ExitStack
) -> tuple[dict[Path, StorageFile], list[DamagedFileError]]:
    """The files, closed with `stack`, and what is wrong with those that are damaged. Raises RecordingError for others.

    They are named as the user named them: a single one by `path`, the recording that was given.
    """
    opened: dict[Path, StorageFile] = {}
    damaged: list[DamagedFileError] = []
    for file, unpacked in unpacked_files(files, stack).items():
        name = path if len(files) == 1 else file
        try:
            with told(name):
                if isinstance(unpacked, Exception):
                    raise unpacked
                opened[name] = _READERS[_kind(file, unpacked)](unpacked)
                stack.callback(opened[name].close)
        except DamagedFileError as error:
            damaged.append(error)
    return opened, damaged


def _kind(file: Path, unpacked: Path) -> str:
    """By the suffix; by how it begins where that is another one, which metadata.yaml may name."""
    if (suffix := _storage_suffix(file)) in _READERS:
        return suffix
    with unpacked.open('rb') as content:
        begin = content.read(16)
    for magic, kind in _MAGIC.items():
        if begin.startswith(magic):
            return kind
    raise DamageError('neither a .mcap nor a .db3 file, and no ROS 1 bag')
