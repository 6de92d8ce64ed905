"""Files that a user names: their kind and size are checked before they are read, and YAML before it is built."""
from __future__ import annotations

import dataclasses
import stat
from pathlib import Path
from typing import Any

import yaml

from ..shown import cut, shown

_KINDS = ((stat.S_ISDIR, 'a folder'), (stat.S_ISFIFO, 'a pipe (FIFO)'), (stat.S_ISSOCK, 'a socket'),
          (stat.S_ISCHR, 'a device'), (stat.S_ISBLK, 'a device'))
_DEPTH = 32
_SCALAR = 1000
"""Characters of an unquoted value: YAML turns these into numbers and dates, which takes time that grows faster."""


class _Loader(getattr(yaml, 'CSafeLoader', yaml.SafeLoader)):  # type: ignore[misc]
    """Plain values; a matrix of OpenCV is the mapping that it is written as."""


_Loader.add_constructor('tag:yaml.org,2002:opencv-matrix', _Loader.construct_yaml_map)


class RefusedFileError(ValueError):
    """A file that is not read: of another kind, too large, or YAML of another shape. The text is one line."""


@dataclasses.dataclass(frozen=True, slots=True)
class Limits:
    """Largest size of a file in bytes, and most values in it where it is YAML."""

    size: int
    values: int = 0


SETTINGS = Limits(2**20, 10_000)
"""For calibrations and parameter files."""
METADATA = Limits(4 * 2**20, 100_000)
"""For metadata.yaml of a bag: some thousand files."""
IMAGE = Limits(2**30)
"""For an image file or ground truth."""
TIMES = Limits(64 * 2**20)
"""For the times of images: some million lines."""


def check_regular(path: Path, limits: Limits) -> None:
    """Raise RefusedFileError where `path` (symlinks followed) is no file that can be read to its end, or is too large.

    Opening anything else, a pipe or a device, could wait for ever.
    """
    try:
        status = path.stat()
    except (FileNotFoundError, NotADirectoryError):
        raise RefusedFileError(f'{path}: there is no such file') from None
    for is_kind, kind in _KINDS:
        if is_kind(status.st_mode):
            raise RefusedFileError(f'{path} is {kind}: give a regular file')
    if status.st_size > limits.size:
        raise RefusedFileError(f'{path} has {status.st_size} bytes, at most {limits.size} are allowed: give '
                               'another file')


def read_text(path: Path, limits: Limits) -> str:
    """The text of a regular file; bytes that are no UTF-8 are replaced. Raises RefusedFileError as `check_regular`."""
    check_regular(path, limits)
    with path.open('rb') as file:
        data = file.read(limits.size + 1)
    if len(data) > limits.size:  # of a file that grows, or does not know its size
        raise RefusedFileError(f'{path} has more than {limits.size} bytes: give another file')
    return data.decode(errors='replace')


def read_yaml(path: Path, limits: Limits) -> Any:
    """What is in a YAML file. Raises RefusedFileError as `read_text` and `parse_yaml`, with the path."""
    text = read_text(path, limits)
    try:
        return parse_yaml(text, limits)
    except RefusedFileError as error:
        raise RefusedFileError(f'{path}: {error}') from None


def parse_yaml(text: str, limits: Limits) -> Any:
    """Plain YAML: no anchors or aliases, which a few lines can blow up to gigabytes; nested up to 32 levels.

    Raises RefusedFileError, in one line, for anything else.
    """
    _check_text(text, limits)
    try:
        return yaml.load(text, _Loader)
    except yaml.YAMLError as error:
        raise RefusedFileError(f'no YAML: {cut(str(error))}') from None
    except RecursionError:
        raise RefusedFileError('no YAML: it is nested too deeply') from None
    except (ValueError, LookupError, TypeError, AttributeError) as error:  # a date, number or truth value that is none
        raise RefusedFileError(f'no YAML, a value is not of its kind: {cut(str(error))}') from None


def _check_text(text: str, limits: Limits) -> None:
    try:
        _check_events(text, limits)
    except yaml.YAMLError as error:
        raise RefusedFileError(f'no YAML: {cut(str(error))}') from None


def _check_events(text: str, limits: Limits) -> None:
    depth = values = 0
    for event in yaml.parse(text, _Loader):
        if anchor := getattr(event, 'anchor', None):
            raise RefusedFileError(f'the YAML has an anchor or alias, {cut(anchor)}: write the values out')
        if isinstance(event, yaml.CollectionStartEvent):
            depth += 1
            if depth > _DEPTH:
                raise RefusedFileError(f'the YAML is nested more than {_DEPTH} levels deep, no file of this kind is')
        elif isinstance(event, yaml.CollectionEndEvent):
            depth -= 1
        elif isinstance(event, yaml.ScalarEvent):
            values += 1
            if values > limits.values:
                raise RefusedFileError(f'the YAML has more than {limits.values} values, no file of this kind has')
            if len(event.value) > _SCALAR and (not event.style or event.tag):
                raise RefusedFileError(f'the YAML has a value of {len(event.value)} characters, at most {_SCALAR} are '
                                       f'allowed without quotes: {shown(event.value)}')
