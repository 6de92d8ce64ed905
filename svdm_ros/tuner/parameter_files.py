"""Parameter files of the page: what there is to be loaded, and what is saved; nothing is overwritten unasked."""
from __future__ import annotations

import os
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import yaml

from svdm_core.files.output_files import write_outputs
from svdm_core.files.user_files import SETTINGS, read_text
from svdm_core.presets import preset_names
from svdm_core.shown import shown

from ..command_line.parameters import node_parameters
from ..node.parameter_set import Value, node_parameter_table

_NAME = re.compile(r'[A-Za-z0-9][A-Za-z0-9_.-]{0,99}\.yaml')
_MOST_FILES = 200


class ParameterFiles:
    """Those of one folder, and the presets that come with the package."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def names(self) -> list[str]:
        """Presets by name, then the parameter files of the folder."""
        return [*preset_names(), *self._files()]

    def read(self, name: str) -> dict[str, Value]:
        """All parameters as a preset or file of `names` has them; ValueError where it is damaged or there is none."""
        if name not in self.names():
            raise ValueError(f'there is no preset {shown(name)}')
        found = node_parameters(self.folder / name if name.endswith('.yaml') else name)
        return {info.name: found.value(info.name) for info in node_parameter_table()}

    def write(self, name: str, values: Mapping[str, Value], *, replace: bool) -> Path:
        """A file that `--params-file` takes: what differs from the defaults.

        Raises ValueError, in one line, for a name that is none, a file that exists (without `replace`), one that is no
        parameter file, and what cannot be written.
        """
        name = name if name.endswith('.yaml') else f'{name}.yaml'
        if not _NAME.fullmatch(name):
            raise ValueError(f'the name {shown(name, 100)} is not allowed: it must be letters, digits, _ - and ., in '
                             f'{self.folder.absolute()}')
        path = self.folder / name
        if os.path.lexists(path) and not replace:
            raise ValueError(f'{path} exists already: choose another name, or allow it to be replaced')
        if os.path.lexists(path) and not self._is_parameter_file(path):
            raise ValueError(f'{path} exists and is no parameter file: choose another name')
        write_outputs({path: parameter_text(values).encode()}, force=replace)
        return path

    def _files(self) -> list[str]:
        try:
            names = sorted(path.name for path in self.folder.iterdir() if _NAME.fullmatch(path.name))
        except OSError:
            return []
        return [name for name in names[:_MOST_FILES] if self._is_parameter_file(self.folder / name)]

    def _is_parameter_file(self, path: Path) -> bool:
        """By its first words; a link, or what is no file, is none."""
        if path.is_symlink() or not path.is_file():
            return False
        try:
            return 'ros__parameters' in read_text(path, SETTINGS)
        except (ValueError, OSError):
            return False


def parameter_text(values: Mapping[str, Value]) -> str:
    """A ROS parameter file for any node name, of what differs from the defaults, in the order of the table."""
    own: dict[str, Any] = {info.name: values[info.name] for info in node_parameter_table()
                           if info.name in values and values[info.name] != info.default}
    text = yaml.safe_dump({'/**': {'ros__parameters': own}}, sort_keys=False)
    return f'# Saved by the tuner. Take this one for the camera it was tuned on.\n{text}'
