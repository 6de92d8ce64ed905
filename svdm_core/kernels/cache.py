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
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numba

_SETTINGS: Any = numba.config  # comes without types
_PACKAGE = Path(__file__).resolve().parents[1]
_KERNEL_FOLDERS = ('kernels', 'matching_cost', 'cost_aggregation', 'disparity_optimization', 'disparity_refinement')
"""All that a kernel can be compiled from. Modules outside must neither hold kernels nor constants of kernels."""
_PREFIX = 'svdm_kernels_'
_KEPT_SECONDS = 30 * 24 * 3600
"""How long the folder of other sources is left alone after its last use: it may be that of another installation."""


@functools.cache
def cache_folder() -> Path:
    """The folder for the sources as they are, in the first place that can be written, else a temporary one.

    Settled once in a process, so that all kernels are in one place.
    """
    name = _PREFIX + fingerprint()
    places = list(_places())
    for place in places:
        if _is_usable(place / name):
            _remove_unused(place, name)
            return place / name
    return _temporary_folder(places)


def _places() -> Iterator[Path]:
    if _SETTINGS.CACHE_DIR:
        yield Path(_SETTINGS.CACHE_DIR).absolute()
    yield _PACKAGE / '__pycache__'
    for base in (os.environ.get('XDG_CACHE_HOME', ''), os.path.expanduser('~/.cache')):
        if os.path.isabs(base):
            yield Path(base) / 'svdm_core'


def fingerprint() -> str:
    """Changes with the sources of the kernels and with numba."""
    digest = hashlib.sha256(numba.__version__.encode())
    for folder in _KERNEL_FOLDERS:
        for source in sorted((_PACKAGE / folder).rglob('*.py')):
            name = source.relative_to(_PACKAGE).as_posix()
            digest.update(b'\0'.join([b'', name.encode(), source.read_bytes()]))
    return digest.hexdigest()[:16]


def _is_usable(folder: Path) -> bool:
    """Whether the folder is there, made if need be, and can be written; notes that it is used now."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        tempfile.TemporaryFile(dir=folder).close()
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


def _temporary_folder(places: list[Path]) -> Path:
    folder = Path(tempfile.mkdtemp(prefix=_PREFIX))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    logging.getLogger(__package__).warning(
        'the kernels are compiled at each start, up to a minute, as nothing can be written to %s: '
        'set NUMBA_CACHE_DIR to a folder that can be written', ' nor to '.join(map(str, places)))
    return folder
