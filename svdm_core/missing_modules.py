"""What to do where a Python package is missing: the one place that knows what it is called by apt and by pip."""
from __future__ import annotations

import shlex
import sys
import sysconfig
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

from .shown import cut, line


class _Package(NamedTuple):
    """apt: empty where Ubuntu has none, or an older one than is needed."""

    pip: str
    apt: str = ''


_PACKAGES = {
    'numba': _Package('numba', 'python3-numba'), 'llvmlite': _Package('numba', 'python3-numba'),
    'numpy': _Package('numpy', 'python3-numpy'), 'yaml': _Package('pyyaml', 'python3-yaml'),
    'cv2': _Package('opencv-python-headless', 'python3-opencv'), 'rich': _Package('rich', 'python3-rich'),
    'matplotlib': _Package('matplotlib', 'python3-matplotlib'), 'jinja2': _Package('jinja2', 'python3-jinja2'),
    'skimage': _Package('scikit-image', 'python3-skimage'), 'optuna': _Package('optuna'),
    'rosbags': _Package('rosbags>=0.11.9,<0.12'), 'dask': _Package('dask', 'python3-dask'),
    'distributed': _Package('distributed', 'python3-distributed'), 'nicegui': _Package('nicegui'),
}
"""By the name that is imported."""
_ROS = ('rclpy', 'rcl_interfaces', 'rosgraph_msgs', 'builtin_interfaces', 'std_msgs', 'sensor_msgs', 'stereo_msgs',
        'diagnostic_msgs', 'ament_index_python', 'launch', 'launch_ros')


def missing_line(error: ImportError) -> str:
    """One line on an import that failed: what is missing and the command that installs it."""
    module = (error.name or '').partition('.')[0]
    if not isinstance(error, ModuleNotFoundError) or not module:
        return line(error)
    return not_installed([module])


def not_installed(modules: Iterable[str]) -> str:
    """One line on modules that are missing, by the names that are imported."""
    names = list(dict.fromkeys(modules))
    told = f'{" and ".join(map(cut, names))} {"is" if len(names) == 1 else "are"} not installed for {sys.executable}'
    from_ros = [name for name in names if name in _ROS]
    packages = [_PACKAGES[name] for name in names if name in _PACKAGES]
    advice = []
    if from_ros:
        advice.append('source /opt/ros/jazzy/setup.bash, or: sudo apt install '
                      + ' '.join(f'ros-jazzy-{name.replace("_", "-")}' for name in from_ros))
    if packages:
        advice.append(_command(packages))
    return f'{told}: {"; and ".join(advice)}' if advice else told


def _command(packages: list[_Package]) -> str:
    """apt's where the system's Python has them all, else pip's for the Python that runs."""
    if _is_the_systems() and all(package.apt for package in packages):
        return shlex.join(['sudo', 'apt', 'install', *dict.fromkeys(package.apt for package in packages)])
    # Beside an apt ROS, whose commands run the system's Python: the packages go to the user's folder, apt's stay.
    beside = ['--user', '--break-system-packages'] if _is_the_systems() else []
    names = dict.fromkeys(package.pip for package in packages)
    return shlex.join([sys.executable or 'python3', '-m', 'pip', 'install', *beside, *names])


def _is_the_systems() -> bool:
    """Whether apt looks after this Python (PEP 668), so that plain `pip install` refuses."""
    return sys.prefix == sys.base_prefix and Path(sysconfig.get_path('stdlib'), 'EXTERNALLY-MANAGED').exists()
