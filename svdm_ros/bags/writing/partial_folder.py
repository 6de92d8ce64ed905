"""The folder of a bag under construction: made by this program alone, marked as its own, locked while it is written.

Nothing is removed but what this program writes there, told by name and kind; a folder without the mark, or with
anything else in it, is refused as it is.
"""
from __future__ import annotations

import contextlib
import fcntl
import os
import shutil
import stat
import tempfile
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import BinaryIO

from ..reading.metadata import METADATA_FILE
from .output_place import PREVIEW_FILE, PREVIEW_FOLDER, SUMMARY_FILE, is_pictures

LOCK_FILE, STATE_FILE, NEW = '.lock', '.finished.json', '.new'
SEGMENT_SUFFIX, IN_WORK = '.segment.mcap', 'in_work_'
_MARK = (b'process_bag of svdm_ros: a bag under construction; the same command goes on from here, and removes this '
         b'folder with it\n')
_FILES = (METADATA_FILE, f'{METADATA_FILE}{NEW}', LOCK_FILE, STATE_FILE, f'{STATE_FILE}{NEW}', SUMMARY_FILE,
          PREVIEW_FILE)
_IN_WORK_FILES = (METADATA_FILE, f'{METADATA_FILE}.tmp')


def partial_path(output: Path) -> Path:
    """Where the bag `output` is under construction."""
    return output.with_name(f'{output.name}.partial')


@contextlib.contextmanager
def locked_folder(output: Path) -> Iterator[Path]:
    """The folder of the bag `output` under construction, made where there is none, and nobody else's meanwhile.

    Raises ValueError, and touches nothing, where something is there that this program did not make, or where another
    process is at it.
    """
    folder = partial_path(output)
    if not os.path.lexists(folder):
        _make(folder)
    with _opened_lock(folder) as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            raise ValueError(f'{folder}: another process is writing it: wait for it, or name another output') from None
        if not _is_of(folder / LOCK_FILE, lock):
            raise ValueError(f'{folder}: another process has just finished it: give the command again')
        check_own(folder)
        yield folder


def check_own(folder: Path) -> None:
    """Raise ValueError where there is anything in the folder that this program does not write there."""
    for path in sorted(folder.iterdir()):
        if not _is_own(path):
            raise ValueError(f'{folder} holds {path.name}, which process_bag did not write, so nothing is removed '
                             'there, with --force neither: move it away, or name another output')


def remove_own(folder: Path, keep: Collection[str]) -> None:
    """Remove what this program wrote into the folder, except the files in `keep`, the lock always kept."""
    for path in sorted(folder.iterdir()):
        if path.name not in (*keep, LOCK_FILE) and _is_own(path):
            if path.is_dir():
                shutil.rmtree(path)
            else:
                path.unlink()


def remove_folder(folder: Path) -> None:
    """Remove what this program wrote, and the folder itself unless something else has come into it."""
    remove_own(folder, ())
    if [path.name for path in folder.iterdir()] == [LOCK_FILE]:
        (folder / LOCK_FILE).unlink()
        folder.rmdir()


def remove_marks(bag: Path) -> None:
    """Remove the marks of a bag that has its name: by the run that finished it, or after a kill by the next."""
    if bag.is_dir() and _is_marked(bag / LOCK_FILE):
        (bag / STATE_FILE).unlink(missing_ok=True)
        (bag / LOCK_FILE).unlink(missing_ok=True)


def _make(folder: Path) -> None:
    """Make the folder with the mark in it, in one step: a kill leaves either both or neither."""
    with tempfile.TemporaryDirectory(prefix=f'.{folder.name}.', dir=folder.parent) as new:
        made = Path(new) / folder.name
        made.mkdir()
        (made / LOCK_FILE).write_bytes(_MARK)
        try:
            made.rename(folder)
        except OSError:
            if not os.path.lexists(folder):  # otherwise somebody else was first
                raise


@contextlib.contextmanager
def _opened_lock(folder: Path) -> Iterator[BinaryIO]:
    told = (f'{folder} was not made by process_bag ({{}}), and is left as it is, with --force too: move it away, or '
            'name another output')
    if folder.is_symlink() or not folder.is_dir():
        raise ValueError(told.format('it is no folder'))
    lock = folder / LOCK_FILE
    if not _is_marked(lock):
        raise ValueError(told.format(f'{LOCK_FILE} in it is not its mark' if os.path.lexists(lock) else
                                     f'there is no {LOCK_FILE} in it'))
    with open(os.open(lock, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC), 'rb+', buffering=0) as file:
        yield file


def _is_marked(lock: Path) -> bool:
    """Whether this is a regular file, no link, that holds the mark."""
    try:
        if not stat.S_ISREG(lock.lstat().st_mode):
            return False
        with open(os.open(lock, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC), 'rb') as file:
            return file.read(len(_MARK) + 1) == _MARK
    except FileNotFoundError:
        return False


def _is_of(path: Path, file: BinaryIO) -> bool:
    """Whether the open file still has that name."""
    try:
        return os.path.samestat(path.lstat(), os.fstat(file.fileno()))
    except FileNotFoundError:
        return False


def is_bag_file(path: Path) -> bool:
    """Whether a file of the bag under construction has this name."""
    return _is_segment(path.name) or _is_volume(path)


def _is_own(path: Path) -> bool:
    """Whether this is, by name and kind, what this program writes into the folder."""
    if path.is_symlink():
        return False
    if path.is_dir():
        return _is_work(path) or (path.name == PREVIEW_FOLDER and is_pictures(path))
    return path.is_file() and (path.name in _FILES or is_bag_file(path))


def _is_work(folder: Path) -> bool:
    """The folder of a file in work, as rosbags makes it: of the file and its metadata."""
    return folder.name.startswith(IN_WORK) and all(
        path.is_file() and not path.is_symlink() and path.name in (*_IN_WORK_FILES, f'{folder.name}.mcap')
        for path in folder.iterdir())


def _is_segment(name: str) -> bool:
    return name.endswith(SEGMENT_SUFFIX) and name.removesuffix(SEGMENT_SUFFIX).isdecimal()


def _is_volume(path: Path) -> bool:
    output = path.parent.name.removesuffix('.partial')
    name, _, number = path.stem.rpartition('_')
    return path.suffix == '.mcap' and name == output and number.isdecimal()
