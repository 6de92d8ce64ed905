"""Files that commands write: all of them or none, and nothing overwritten unasked."""
from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path


def check_outputs(paths: Iterable[Path], force: bool) -> None:
    """Refuse, before the work, what could not be written after it.

    Raises ValueError naming a path that exists (without `force`), is a folder, is named twice, or lies in no folder.
    """
    seen: set[Path] = set()
    for path in paths:
        if path.is_dir():
            raise ValueError(f'{path} is a folder: name a file')
        if not force and os.path.lexists(path):
            raise ValueError(f'{path} exists already: remove it, name another file, or give --force')
        if not path.parent.is_dir():
            raise ValueError(f'{path}: there is no folder {path.parent}')
        if not os.access(path.parent, os.W_OK):
            raise ValueError(f'{path}: the folder {path.parent} cannot be written')
        if path.resolve() in seen:
            raise ValueError(f'{path} is named twice: each output needs a file of its own')
        seen.add(path.resolve())


def write_outputs(contents: Mapping[Path, bytes], force: bool) -> None:
    """Write every file under a temporary name in its folder, then rename them all.

    Raises ValueError as `check_outputs`, and where a file cannot be written (a full disk); then none is there.
    """
    check_outputs(contents, force)
    waiting: dict[Path, str] = {}
    try:
        for path, content in contents.items():
            try:
                handle, waiting[path] = tempfile.mkstemp(dir=path.parent, prefix=f'.{path.name}.')
                with open(handle, 'wb') as file:
                    file.write(content)
                    os.fchmod(file.fileno(), 0o666 & ~_umask())
            except OSError as error:
                raise ValueError(f'{path}: cannot be written: {error.strerror}') from None
        for path, temporary in list(waiting.items()):
            os.replace(temporary, path)
            del waiting[path]
    finally:
        for temporary in waiting.values():
            Path(temporary).unlink(missing_ok=True)


def _umask() -> int:
    """The process's mask of file rights; it can only be read by setting it."""
    mask = os.umask(0o077)
    os.umask(mask)
    return mask
