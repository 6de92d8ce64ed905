"""Where numba keeps the compiled kernels: a folder of its own for each state of the sources, so that none is outdated.

numba itself looks only at the file a kernel is in; constants and functions of other modules are compiled into it too.
"""
from __future__ import annotations

import atexit
import contextlib
import functools
import hashlib
import logging
import os
import shutil
import stat
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba

_SETTINGS: Any = numba.config  # comes without types
PACKAGE = Path(__file__).resolve().parents[1]
_KERNEL_FOLDERS = ('kernels', 'matching_cost', 'cost_aggregation', 'disparity_optimization', 'disparity_refinement')
"""All that a kernel can be compiled from. Modules outside must neither hold kernels nor constants of kernels."""
_PREFIX = 'svdm_kernels_'
_KEPT_SECONDS = 30 * 24 * 3600
"""How long the folder of other sources is left alone after its last use: it may be that of another installation."""


_ROOM = bytes(2**20)
"""What must fit on the disk for a place to be taken: some kernels."""
_LOG = logging.getLogger(__package__)


@functools.cache
def cache_folder() -> Path | None:
    """The folder for the sources as they are: in the first place that can be written, else where kernels are already,
    else a temporary one; None where there is none. What others could write to is no place.

    Settled once in a process, so that all kernels are in one place.
    """
    name = _PREFIX + fingerprint()
    folders = [place / name for place in _places()]
    ours = [folder for folder in folders if _is_ours(folder)]
    for folder in ours:
        if _is_writable(folder):
            _remove_unused(folder.parent, name)
            return folder
    return next((folder for folder in ours if any(folder.rglob('*.nbi'))), None) or _temporary_folder(folders)


def _places() -> Iterator[Path]:
    if _SETTINGS.CACHE_DIR:
        yield Path(_SETTINGS.CACHE_DIR).absolute()
    yield PACKAGE / '__pycache__'
    for base in (os.environ.get('XDG_CACHE_HOME', ''), os.path.expanduser('~/.cache')):
        if os.path.isabs(base):
            yield Path(base) / 'svdm_core'


def fingerprint() -> str:
    """Changes with the sources of the kernels and with numba."""
    digest = hashlib.sha256(numba.__version__.encode())
    for folder in _KERNEL_FOLDERS:
        for source in sorted((PACKAGE / folder).rglob('*.py')):
            name = source.relative_to(PACKAGE).as_posix()
            digest.update(b'\0'.join([b'', name.encode(), source.read_bytes()]))
    return digest.hexdigest()[:16]


def is_only_ours(status: os.stat_result) -> bool:
    """Whether a file or folder is of this user, and neither its group nor others may write to it."""
    return status.st_uid == os.geteuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _is_ours(folder: Path) -> bool:
    """Whether the folder, made if need be, is this user's alone; a line where somebody else may put files into it."""
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        place, status = folder.parent.stat(), folder.lstat()
    except OSError:
        return False
    anybody = place.st_mode & stat.S_IWOTH and not place.st_mode & stat.S_ISVTX
    if stat.S_ISDIR(status.st_mode) and is_only_ours(status) and not anybody:
        return True
    _LOG.warning('no kernels are taken from %s: it must be a folder of your own that nobody else can write to, and no '
                 'symlink: remove it, or set NUMBA_CACHE_DIR to another folder', folder.parent if anybody else folder)
    return False


def _is_writable(folder: Path) -> bool:
    """Whether there is room for kernels; notes that the folder is used now."""
    try:
        with tempfile.TemporaryFile(dir=folder) as file:
            file.write(_ROOM)
        os.utime(folder)
    except OSError:
        return False
    return True


def _remove_unused(place: Path, used: str) -> None:
    """A process that still runs from a folder removed here compiles anew what it lacks."""
    for folder in place.glob(f'{_PREFIX}*'):
        with contextlib.suppress(OSError):
            if folder.name != used and time.time() - folder.stat().st_mtime > _KEPT_SECONDS:
                shutil.rmtree(folder, ignore_errors=True)


def _temporary_folder(folders: list[Path]) -> Path | None:
    _LOG.warning(
        'the kernels are compiled at each start, up to a minute, as nothing can be written to %s: '
        'set NUMBA_CACHE_DIR to a folder of your own with space that can be written',
        ' nor to '.join(str(folder.parent) for folder in folders))
    try:
        folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    except OSError:
        return None
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    return folder
