"""Compiled kernels on disk: nothing is loaded that is damaged, or that somebody else could have written.

numba unpickles what it finds: a damaged file ends the process at each start, and a planted one runs as its code.
"""
from __future__ import annotations

import contextlib
import errno
import hashlib
import logging
import os
import pickle
import stat
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

from numba.core import caching

from .cache import PACKAGE, cache_folder, is_only_ours

_DIGEST = hashlib.sha256
_DIGEST_SIZE = _DIGEST().digest_size
_LOG = logging.getLogger(__package__)
_told: set[str] = set()


def kernel_cache(function: Callable[..., Any]) -> Any:
    """What a numba dispatcher has as `_cache`; one that keeps nothing where there is no folder to keep it in."""
    return caching.NullCache() if cache_folder() is None else _KernelCache(function)


class _Locator(caching.UserProvidedCacheLocator):
    """In `cache_folder()`, and nowhere else. The package's kernels are found by their place in it: the folder stands
    for its sources, so it serves all copies of them, in a checkout as in an installation."""

    def __init__(self, function: Callable[..., Any], source: str) -> None:
        super().__init__(function, source)
        file = Path(source).resolve()
        self._is_own = file.is_relative_to(PACKAGE)
        place = file.parent.relative_to(PACKAGE) if self._is_own else self.get_suitable_cache_subpath(source)
        self._cache_path = str(Path(str(cache_folder()), place))

    def get_source_stamp(self) -> Any:
        return '' if self._is_own else super().get_source_stamp()

    @classmethod
    def from_function(cls, function: Callable[..., Any], source: str) -> _Locator:
        return cls(function, source)


class _Results(caching.CompileResultCacheImpl):
    _locator_classes = [_Locator]  # noqa: RUF012 (as numba has it)


class _KernelCache(caching.FunctionCache):
    """As numba's, on checked files; where they can be neither read nor written, kernels are compiled."""

    _impl_class = _Results

    def __init__(self, function: Callable[..., Any]) -> None:
        super().__init__(function)
        self._cache_file = _CheckedFiles(
            self._cache_path, self._impl.filename_base, self._impl.locator.get_source_stamp())

    def load_overload(self, signature: Any, target_context: Any) -> Any:
        try:
            return super().load_overload(signature, target_context)
        except OSError as error:
            _tell(f'compiled kernels cannot be read, they are compiled anew: {_shown(error, self._cache_path)}')
            return None

    def save_overload(self, signature: Any, data: Any) -> None:
        try:
            super().save_overload(signature, data)
        except OSError as error:
            _tell('compiled kernels cannot be kept, they are compiled at each start: '
                  f'{_shown(error, self._cache_path)}: set NUMBA_CACHE_DIR to a folder with space that can be written')


class _CheckedFiles(caching.IndexDataCacheFile):
    """An index and its data, each file with a digest behind it."""

    def _load_index(self) -> dict[Any, str]:
        content = self._read(self._index_path)
        if content is None:
            return {}
        stamp, overloads = pickle.loads(content)
        return dict(overloads) if stamp == self._source_stamp else {}

    def _save_index(self, overloads: dict[Any, str]) -> None:
        _write(self._index_path, self._dump((self._source_stamp, overloads)))

    def _load_data(self, name: str) -> Any:
        content = self._read(self._data_path(name))
        if content is None:
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT), self._data_path(name))
        return pickle.loads(content)

    def _save_data(self, name: str, data: Any) -> None:
        _write(self._data_path(name), self._dump(data))

    def _read(self, path: str) -> bytes | None:
        """What was written; None where there is no such file, or none to be trusted, which is removed."""
        try:
            number = os.open(path, os.O_RDONLY | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK)
        except FileNotFoundError:
            return None
        except OSError as error:
            if error.errno != errno.ELOOP:
                raise
            _drop(path, 'a symlink')
            return None
        with os.fdopen(number, 'rb') as file:
            status = os.fstat(number)
            if not stat.S_ISREG(status.st_mode) or not is_only_ours(status):
                _drop(path, 'not only yours')
                return None
            content = file.read()
        if _DIGEST(content[:-_DIGEST_SIZE]).digest() != content[-_DIGEST_SIZE:]:
            _drop(path, 'damaged')
            return None
        return content[:-_DIGEST_SIZE]


def _drop(path: str, trouble: str) -> None:
    _tell(f'compiled kernels in {Path(path).parent} are {trouble}, say {Path(path).name}: they are removed and '
          'compiled anew')
    with contextlib.suppress(OSError):
        os.unlink(path)


def _write(path: str, content: bytes) -> None:
    """Whatever the moment, `path` is whole; nobody else may write to it, whatever the umask."""
    with tempfile.NamedTemporaryFile(dir=os.path.dirname(path), delete=False) as file:
        try:
            file.write(content + _DIGEST(content).digest())
            file.flush()
            os.replace(file.name, path)
        except BaseException:
            with contextlib.suppress(OSError):
                os.unlink(file.name)
            raise


def _tell(line: str) -> None:
    """One line in a process for each kind of trouble, not one for each kernel."""
    kind = line.partition(',')[0]
    if kind not in _told:
        _told.add(kind)
        _LOG.warning(line)


def _shown(error: OSError, path: str) -> str:
    return f'{error.filename or path}: {error.strerror or error}'
