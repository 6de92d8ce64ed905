"""Files that are written at the end of a long run: checked before it, and written whole or not at all."""
from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterable
from pathlib import Path


def check_outputs(paths: Iterable[Path], force: bool = False) -> None:
    """ValueError where one is there already and `force` is not given; OSError where one cannot be written."""
    seen: set[Path] = set()
    for path in paths:
        if path.is_dir() or path.absolute() in seen:
            raise ValueError(f'{path}: {"a folder" if path.is_dir() else "named twice"}: name another file')
        if path.exists() and not force:
            raise ValueError(f'{path} exists already: remove it, name another file, or give --force')
        if not path.parent.is_dir():
            raise FileNotFoundError(f'{path} cannot be written: there is no folder {path.parent}')
        if not os.access(path.parent, os.W_OK):
            raise PermissionError(f'{path} cannot be written: the folder {path.parent} is read-only')
        seen.add(path.absolute())


def write_whole(path: Path, text: str, force: bool = False) -> None:
    """Write `text` so that no reader, nor an interruption, meets half of it. Raises as `check_outputs`."""
    check_outputs([path], force)
    descriptor, name = tempfile.mkstemp(dir=path.parent, prefix=f'.{path.name}.')
    try:
        with os.fdopen(descriptor, 'w', encoding='utf-8') as file:
            file.write(text)
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(name, 0o666 & ~umask)
        os.replace(name, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise
