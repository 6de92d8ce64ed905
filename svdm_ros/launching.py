"""What the launch files share: their arguments, the checks of what was given, and what they start."""
from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import EnvironmentVariable, LaunchConfiguration
from launch_ros.actions import Node

from svdm_core.files.user_files import SETTINGS, RefusedFileError, read_yaml
from svdm_core.presets import preset_folder, preset_names
from svdm_core.shown import nearest, shown

Arguments = Mapping[str, tuple[str, str]]
"""Launch arguments: name -> (default, description)."""

Given = Mapping[str, str]
"""Launch arguments: name -> value, as text."""

NODE_ARGUMENTS: Arguments = {
    'params_file': ('default', 'a preset (accurate, default, fast, paper ...), or the path of a ROS parameter file'),
    'use_sim_time': ('', 'true: take the time from /clock; empty: as params_file has it'),
    'approximate_sync_tolerance': ('', 'largest stamp difference of a pair in s; empty: as params_file has it'),
    'input': ('', 'raw: the node rectifies left/image_raw and right/image_raw; empty: as params_file has it'),
    'transport': ('', 'compressed: the node subscribes to <image topic>/compressed; empty: as params_file has it'),
    'layout': ('', 'side_by_side: one image holds both views; empty: as params_file has it'),
}
"""How a node works."""

CAMERA_ARGUMENTS: Arguments = {
    'namespace': ('', 'namespace of the node and of its relative topics'),
    'left_namespace': ('left', 'where the image and camera_info of the left camera are'),
    'right_namespace': ('right', 'where the image and camera_info of the right camera are'),
    'left_image': ('', 'topic of the left image; empty: <left_namespace>/image_rect, or image_raw with input:=raw'),
    'right_image': ('', 'topic of the right image; empty: <right_namespace>/image_rect, or image_raw with input:=raw'),
    'left_info': ('', 'topic of the left camera_info; empty: <left_namespace>/camera_info'),
    'right_info': ('', 'topic of the right camera_info; empty: <right_namespace>/camera_info'),
    'image': ('', 'topic of the one image that holds both views; empty: image_rect, or image_raw with input:=raw'),
}
"""Where its camera is."""

RVIZ_ARGUMENTS: Arguments = {
    'rviz': ('true', 'true: start RViz as well, where rviz2 is installed'),
    'rviz_config': ('', 'layout of RViz; empty: stereo.rviz of this package'),
    'fixed_frame': ('', 'frame_id of the left image, or any frame of tf; empty: the one in the layout'),
}
"""How RViz shows the results."""

RVIZ_TOPICS = ('points2', 'depth/image_rect', 'disparity/preview')
"""What config/stereo.rviz shows."""

_PROFILES_FILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
_TRUTH = {'true': True, 'yes': True, '1': True, 'false': False, 'no': False, '0': False}


class LaunchArgumentError(ValueError):
    """A launch argument is wrong. launch prints the text as one line and ends with exit code 1."""


def launch_description(
    file: str, arguments: Arguments, actions: Callable[[Given], list[Any]]
) -> LaunchDescription:
    """Declares `arguments`, checks what was given, and starts `actions(given)`.

    file: the launch file, which calls this with its `__file__`.
    """
    def start(context: LaunchContext) -> list[Any]:
        _refuse_unknown(context, file, arguments)
        return actions({name: LaunchConfiguration(name).perform(context) for name in arguments})

    profile = EnvironmentVariable(_PROFILES_FILE, default_value=str(preset_folder() / 'fastdds.xml'))
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=description)
          for name, (default, description) in arguments.items()),
        SetEnvironmentVariable(_PROFILES_FILE, profile),
        OpaqueFunction(function=start),
    ])


def disparity_node(given: Given) -> Node:
    """The node. Arguments left empty are not handed on, so that the parameter file decides."""
    file = parameter_file(given['params_file'])
    overrides = _overrides(given)
    raw = overrides.get('input', _value_in_file(file, 'input')) == 'raw'
    return Node(
        package='svdm_ros',
        executable='disparity_node',
        name='disparity_node',
        namespace=given['namespace'],
        output='screen',
        parameters=[str(file), *([overrides] if overrides else [])],
        remappings=_remappings(given, raw),
    )


def rviz(given: Given) -> list[Any]:
    """RViz with the layout; a line where it is not installed; nothing where it is not wanted."""
    if not _read_bool('rviz', given['rviz']):
        return []
    try:
        get_package_prefix('rviz2')
    except PackageNotFoundError:
        return [LogInfo(msg='rviz2 is not installed: starting the node without it. Install ros-jazzy-rviz2, or give '
                            'rviz:=false to be rid of this line')]
    layout = _existing('rviz_config', given['rviz_config'] or str(preset_folder() / 'stereo.rviz'))
    frame = ['-f', given['fixed_frame']] if given['fixed_frame'] else []
    clock = {'use_sim_time': _read_bool('use_sim_time', given['use_sim_time'])} if given['use_sim_time'] else None
    return [Node(
        package='rviz2',
        executable='rviz2',
        name='rviz2',
        namespace=given['namespace'],
        arguments=['-d', str(layout), *frame],
        parameters=[clock] if clock else [],
        remappings=[(f'/{topic}', topic) for topic in RVIZ_TOPICS],  # into the namespace
    )]


def parameter_file(name_or_path: str) -> Path:
    """The file of a preset (`fast`), or the file itself (`/my/params.yaml`).

    Raises LaunchArgumentError, which lists the presets, where there is none.
    """
    path = Path(name_or_path).expanduser()
    if name_or_path in preset_names():
        return preset_folder() / f'{name_or_path}.yaml'
    if path.is_file():
        return path
    what = 'no file' if path.suffix in ('.yaml', '.yml') or len(path.parts) > 1 else 'no preset'
    raise LaunchArgumentError(
        f'params_file: {what} {shown(name_or_path)}. Give the path of a ROS parameter file, or a preset: '
        f'{", ".join(preset_names())}')


def _refuse_unknown(context: LaunchContext, file: str, arguments: Arguments) -> None:
    """`ros2 launch` itself takes any name and says nothing. Raises LaunchArgumentError.

    Where another launch file includes this one, the names on the command line are that file's, and not ours to judge.
    """
    if not any(Path(word).name == Path(file).name for word in sys.argv):
        return
    for name in (word.partition(':=')[0] for word in context.argv if ':=' in word):
        if name not in arguments:
            near = nearest(name, arguments)
            hint = f'Did you mean {near}? ' if near else ''
            raise LaunchArgumentError(f'unknown launch argument {shown(name)}. {hint}Known are: {", ".join(arguments)}')


def _overrides(given: Given) -> dict[str, Any]:
    """The parameters that were given as launch arguments."""
    readers: dict[str, Callable[[str, str], Any]] = {
        'use_sim_time': _read_bool, 'approximate_sync_tolerance': _read_float}
    names = [name for name in NODE_ARGUMENTS if name != 'params_file' and given[name]]
    return {name: readers.get(name, _read_text)(name, given[name]) for name in names}


def _read_bool(name: str, text: str) -> bool:
    if text.lower() not in _TRUTH:
        raise LaunchArgumentError(f'{name}: {shown(text)} is not allowed. Give one of: {", ".join(_TRUTH)}')
    return _TRUTH[text.lower()]


def _read_float(name: str, text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise LaunchArgumentError(f'{name}: {shown(text)} is not a number') from None


def _read_text(_: str, text: str) -> str:
    return text


def _existing(name: str, path: str) -> Path:
    if not Path(path).expanduser().is_file():
        raise LaunchArgumentError(f'{name}: no file {shown(path)}')
    return Path(path).expanduser()


def _value_in_file(file: Path, name: str) -> Any:
    """What a ROS parameter file sets for any node; None where it is silent. What is wrong with it, the node says."""
    try:
        document = read_yaml(file, SETTINGS)
        return next((node['ros__parameters'][name] for node in document.values()
                     if name in node['ros__parameters']), None)
    except (RefusedFileError, AttributeError, KeyError, TypeError):
        return None


def _remappings(given: Given, raw: bool) -> list[tuple[str, str]]:
    """From the node's names to the camera's.

    The node publishes left/image_rect where it rectifies itself: only the names it subscribes to may be remapped.
    """
    name = 'image_raw' if raw else 'image_rect'
    rules = []
    for side in ('left', 'right'):
        namespace = given[f'{side}_namespace']
        rules += _image_rules(f'{side}/{name}', given[f'{side}_image'] or f'{namespace}/{name}')
        rules.append((f'{side}/camera_info', given[f'{side}_info'] or f'{namespace}/camera_info'))
    if given['image']:
        rules += _image_rules(name, given['image'])
    return rules


def _image_rules(name: str, topic: str) -> list[tuple[str, str]]:
    """An image and its compressed twin: ROS remaps whole names only."""
    return [(name, topic), (f'{name}/compressed', f'{topic}/compressed')]
