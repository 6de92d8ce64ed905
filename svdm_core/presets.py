"""Presets: named parameter sets, kept as ROS 2 parameter files that `--params-file` takes as they are."""
from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from .files.user_files import SETTINGS, read_yaml
from .parameters import MatcherParameters
from .shown import shown


class PresetNotFoundError(FileNotFoundError, ValueError):
    """There is no such preset. A wrong value, and a missing file: to be caught as either."""


def preset_folder() -> Path:
    """The folder of the presets that come with the package: of the checkout, else of the installation prefix.

    Raises PresetNotFoundError naming the places where there is none.
    """
    package = Path(__file__).resolve().parent
    places = [package.parent / 'config', *(up / 'share' / 'svdm_ros' / 'config' for up in package.parents)]
    for place in places:
        if (place / 'default.yaml').is_file():
            return place
    raise PresetNotFoundError(f'no presets installed: no default.yaml in {places[0]} nor in share/svdm_ros/config')


def preset_names() -> list[str]:
    """The presets that come with the package."""
    return sorted(path.stem for path in preset_folder().glob('*.yaml'))


def load_preset(name_or_path: str | Path) -> MatcherParameters:
    """Read a preset by name ('paper') or by file ('my.yaml').

    Raises ValueError: naming the presets there are for an unknown name or a missing file (PresetNotFoundError),
    and naming file and reason for anything in it that is not a set of matcher parameters.
    """
    values = preset_values(name_or_path)
    try:
        return MatcherParameters.from_mapping(values)
    except ValueError as error:
        raise ValueError(f'{_preset_path(name_or_path)}: {error}') from None


def preset_values(name_or_path: str | Path) -> dict[str, Any]:
    """What a preset, or any ROS parameter file of one node, sets: name -> value, not checked. Raises as `load_preset`.
    """
    path = _preset_path(name_or_path)
    if not path.exists():
        raise PresetNotFoundError(f'no preset {shown(str(name_or_path))}: {_there_are()}, or give a .yaml file')
    document = read_yaml(path, SETTINGS)
    try:
        return _ros_parameters(document)
    except ValueError as error:
        raise ValueError(f'{path}: {error}') from None


def _preset_path(name_or_path: str | Path) -> Path:
    path = Path(name_or_path)
    return path if path.suffix in ('.yaml', '.yml') else preset_folder() / f'{name_or_path}.yaml'


def preset_text(parameters: MatcherParameters, comment: str) -> str:
    """A preset file that `load_preset` and the node read: what differs from the defaults, without the search range,
    which is the camera's.

    comment: one line, which says when to take it.
    """
    default = MatcherParameters().as_dict()
    own = {name: value for name, value in parameters.as_dict().items()
           if name not in ('min_disparity', 'num_disparities') and value != default[name]}
    values = yaml.safe_dump({'/**': {'ros__parameters': own}}, sort_keys=False)
    return f'# {" ".join(comment.split())}\n{values}'


def _there_are() -> str:
    try:
        return f'there are {", ".join(preset_names())}'
    except PresetNotFoundError:  # a file was asked for where none is installed
        return 'none is installed'


def _ros_parameters(document: Any) -> dict[str, Any]:
    """The mapping under `<node name>: ros__parameters:`; there must be exactly one node."""
    if isinstance(document, dict) and len(document) == 1:
        node = next(iter(document.values()))
        if isinstance(node, dict) and set(node) == {'ros__parameters'} and isinstance(node['ros__parameters'], dict):
            return _named(node['ros__parameters'])
    raise ValueError("not a ROS parameter file: expected '/**:', below it 'ros__parameters:', below it name: value")


def _named(values: dict[Any, Any]) -> dict[str, Any]:
    for name in values:
        if not isinstance(name, str):  # YAML reads 1, yes and 2024-01-01 as something else
            raise ValueError(f'the parameter name {shown(name)} is not allowed: it must be a string')
    return values
