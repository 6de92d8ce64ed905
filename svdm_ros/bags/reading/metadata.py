"""metadata.yaml of a rosbag2, looked at before anything opens what it names."""
from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePath
from typing import Any, NamedTuple

from rosbags.interfaces import Qos

from svdm_core.files.user_files import METADATA, Limits, RefusedFileError, check_regular, parse_yaml, read_yaml
from svdm_core.shown import shown

from .storage import qos_of

METADATA_FILE = 'metadata.yaml'
ROOT = 'rosbag2_bagfile_information'
_NEWEST = 9
"""Version of metadata.yaml."""


class BagMetadata(NamedTuple):
    """What metadata.yaml tells: names of the files in their order, messages of each topic, QoS offered."""

    files: list[str]
    counts: dict[str, int]
    qos: dict[str, tuple[Qos, ...]]


class UnusableMetadataError(ValueError):
    """A metadata.yaml that does not tell what is in the bag; the files of the bag can be read without it."""


def bag_metadata(path: Path) -> BagMetadata:
    """Read metadata.yaml.

    Raises UnusableMetadataError where it is empty, damaged, of another version, or does not name the files.
    Raises RefusedFileError where it, or a file that it names, is no regular file, or where its QoS are hostile.
    """
    check_regular(path, METADATA)
    try:
        information = read_metadata(path)
    except RefusedFileError as error:
        raise UnusableMetadataError(str(error)) from None
    topics = [dict(topic) for topic in _mappings(information.get('topics_with_message_count'))]
    counts, qos = {}, {}
    for topic in topics:
        told = next(_mappings([topic.get('topic_metadata')]), {})
        name, count, profiles = told.get('name'), topic.get('message_count'), told.get('offered_qos_profiles')
        if isinstance(profiles, str):  # up to version 8 YAML in YAML
            profiles = _parsed(path, profiles)
        if isinstance(name, str):
            counts[name] = count if isinstance(count, int) else 0
            qos[name] = qos_of(profiles)
    _check(path, information)
    return BagMetadata(_file_names(information), counts, qos)


def _check(path: Path, information: Mapping[str, Any]) -> None:
    version, storage = information.get('version'), information.get('storage_identifier')
    if not isinstance(version, int) or not 1 <= version <= _NEWEST:
        raise UnusableMetadataError(f'{path}: its version is {shown(version)}, versions 1 to {_NEWEST} are known')
    if not storage:
        raise UnusableMetadataError(f'{path}: its storage_identifier is {shown(storage)}')
    names = _file_names(information)
    if not names:
        raise UnusableMetadataError(f'{path}: it names no files')
    for name in names:
        if (path.parent / name).exists():
            check_regular(path.parent / name, Limits(sys.maxsize))


def _parsed(path: Path, profiles: str) -> Any:
    try:
        return parse_yaml(profiles, METADATA)
    except RefusedFileError as error:
        raise RefusedFileError(f'{path}: offered_qos_profiles: {error}') from None


def read_metadata(path: Path) -> dict[str, Any]:
    """What metadata.yaml tells of a bag. Raises RefusedFileError where it is not plain YAML, or tells nothing."""
    content = read_yaml(path, METADATA)
    information = content.get(ROOT) if isinstance(content, Mapping) else None
    if not isinstance(information, dict):
        raise RefusedFileError(f'{path}: no metadata of a rosbag2, it has no {ROOT}')
    return information


def listed_files(path: Path) -> list[str]:
    """The names of the files of a bag, by its metadata.yaml. Raises RefusedFileError as `read_metadata`."""
    return _file_names(read_metadata(path))


def _file_names(information: Mapping[str, Any]) -> list[str]:
    names = information.get('relative_file_paths')
    return [PurePath(name).name for name in names if isinstance(name, str)] if isinstance(names, list) else []


def _mappings(value: Any) -> Iterator[Mapping[str, Any]]:
    return iter([item for item in value if isinstance(item, Mapping)] if isinstance(value, list) else [])
