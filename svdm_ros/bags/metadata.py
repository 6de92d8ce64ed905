"""metadata.yaml of a rosbag2, looked at before anything opens what it names."""
from __future__ import annotations

import sys
from collections.abc import Mapping
from pathlib import Path, PurePath
from typing import Any

from .user_files import METADATA, Limits, RefusedFileError, check_regular, parse_yaml, read_yaml

METADATA_FILE = 'metadata.yaml'
ROOT = 'rosbag2_bagfile_information'


def check_metadata(path: Path) -> None:
    """Raise RefusedFileError in one line, naming the file, where metadata.yaml is not plain YAML, or names a file of the bag
    that is none.

    Fields that are missing or of another type, and files that are missing, are left to those who read the bag.
    """
    content = read_yaml(path, METADATA)
    information = content.get(ROOT) if isinstance(content, Mapping) else None
    if not isinstance(information, Mapping):
        raise RefusedFileError(f'{path}: no metadata of a rosbag2, it has no {ROOT}: remove it, the files beside it are read '
                         'without it too')
    for name in _strings(information.get('relative_file_paths')):
        file = path.parent / PurePath(name).name
        if file.exists():
            check_regular(file, Limits(sys.maxsize))
    for topic in _mappings(information.get('topics_with_message_count')):
        offered = next(_mappings([topic.get('topic_metadata')]), {}).get('offered_qos_profiles')
        if isinstance(offered, str):  # up to version 8 YAML in YAML
            try:
                parse_yaml(offered, METADATA)
            except RefusedFileError as error:
                raise RefusedFileError(f'{path}: offered_qos_profiles: {error}') from None


def _strings(value: Any) -> list[str]:
    return [item for item in value if isinstance(item, str)] if isinstance(value, list) else []


def _mappings(value: Any) -> Any:
    return iter([item for item in value if isinstance(item, Mapping)] if isinstance(value, list) else [])
