"""metadata.yaml of a rosbag2, looked at before anything opens what it names."""
from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path, PurePath
from typing import Any

from svdm_core.files.user_files import METADATA, Limits, RefusedFileError, check_regular, parse_yaml, read_yaml

METADATA_FILE = 'metadata.yaml'
ROOT = 'rosbag2_bagfile_information'


def check_metadata(path: Path) -> None:
    """Raise RefusedFileError, naming the file, where metadata.yaml is not plain YAML, or names what is no file.

    Fields that are missing or of another type, and files that are missing, are left to those who read the bag.
    """
    information = read_metadata(path)
    for name in _file_names(information):
        file = path.parent / name
        if file.exists():
            check_regular(file, Limits(sys.maxsize))
    for topic in _mappings(information.get('topics_with_message_count')):
        offered = next(_mappings([topic.get('topic_metadata')]), {}).get('offered_qos_profiles')
        if isinstance(offered, str):  # up to version 8 YAML in YAML
            try:
                parse_yaml(offered, METADATA)
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
