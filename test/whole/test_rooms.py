"""The rooms of svdm_ros: which of them may import which, and which do without ROS."""
import ast
import subprocess
import sys

import pytest
from checkout import CHECKOUT

PACKAGE = CHECKOUT / 'svdm_ros'
MODULES = sorted(PACKAGE.rglob('*.py'))
WITH_RCLPY = ('node', 'processes', 'benchmark', 'demo', 'soak', 'bags/play', 'tuner')
NODE_STARTERS = ('demo', 'benchmark', 'soak', 'tuner')


def room(path):
    """The folder of a module below svdm_ros, '' for its top."""
    folder = path.relative_to(PACKAGE).parent.as_posix()
    return '' if folder == '.' else folder


def imported(path):
    """Dotted names of all modules it imports, anywhere; those of this package as from its top."""
    package = ('svdm_ros', *path.relative_to(PACKAGE).parent.parts)
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            parents = package[:len(package) - node.level + 1] if node.level else ()
            yield '.'.join([*parents, *([node.module] if node.module else [])])


@pytest.mark.parametrize('path', MODULES, ids=lambda path: str(path.relative_to(PACKAGE)))
def test_a_module_imports_what_its_room_may(path):
    names = set(imported(path))
    for starter in NODE_STARTERS:
        if room(path) != starter:
            assert not [name for name in names if name.startswith(f'svdm_ros.{starter}')]
    if not room(path).startswith(WITH_RCLPY):
        assert not [name for name in names if name.split('.')[0] == 'rclpy']


@pytest.mark.parametrize('module', ['node.parameter_set', 'bags.process.process_command', 'bags.images.image_bag'])
def test_it_loads_no_ros(module):
    code = (f'import sys, svdm_ros.{module}\n'
            'print({"rclpy", "sensor_msgs", "stereo_msgs", "rcl_interfaces"} & set(sys.modules))')
    run = subprocess.run([sys.executable, '-c', code], cwd=CHECKOUT, capture_output=True, text=True, timeout=60)
    assert run.stdout == 'set()\n', run.stderr


def test_the_tests_mirror_the_rooms():
    folders = {path.parent.relative_to(CHECKOUT / 'test' / 'ros') for path in (CHECKOUT / 'test' / 'ros').rglob('*.py')}
    assert [str(folder) for folder in folders if not (PACKAGE / folder).is_dir()] == []
