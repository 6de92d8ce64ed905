"""A package that is missing is one line with the command that installs it, for the Python that runs."""
import ast
import importlib
import sys

import pytest
from checkout import CHECKOUT

from svdm_core import missing_modules
from svdm_core.commands import cli
from svdm_core.missing_modules import missing_line, not_installed
from svdm_ros.bags import images_to_bag, process_bag


@pytest.fixture
def system(monkeypatch):
    """As where Ubuntu's Python runs; a venv is what the tests run in."""
    monkeypatch.setattr(missing_modules, '_is_the_systems', lambda: True)


def test_in_a_venv_pip_of_that_venv_is_told():
    assert not_installed(['numba', 'cv2']).endswith(
        f'numba and cv2 are not installed for {sys.executable}: '
        f'{sys.executable} -m pip install numba opencv-python-headless')


def test_beside_an_apt_ros_it_is_apt_and_pip_only_for_what_apt_has_not(system):
    assert not_installed(['numba', 'yaml']).endswith(': sudo apt install python3-numba python3-yaml')
    assert not_installed(['rosbags', 'rich']).endswith(
        f": {sys.executable} -m pip install --user --break-system-packages 'rosbags>=0.11.9,<0.12' rich")


def test_what_belongs_to_ros_comes_with_ros():
    assert not_installed(['stereo_msgs']).endswith(
        ': source /opt/ros/jazzy/setup.bash, or: sudo apt install ros-jazzy-stereo-msgs')


def test_what_pip_is_told_is_what_setup_asks_for():
    calls = [node for node in ast.walk(ast.parse((CHECKOUT / 'setup.py').read_text())) if isinstance(node, ast.keyword)]
    [extras] = [ast.literal_eval(call.value) for call in calls if call.arg == 'extras_require']
    wanted = {name for extra, names in extras.items() if extra != 'test' for name in names}
    assert wanted <= {package.pip for package in missing_modules._PACKAGES.values()}


def test_what_apt_is_told_is_what_rosdep_installs():
    manifest = (CHECKOUT / 'package.xml').read_text()
    for name in ('numba', 'numpy', 'cv2', 'yaml'):
        assert f'<exec_depend>{missing_modules._PACKAGES[name].apt}</exec_depend>' in manifest


@pytest.mark.parametrize('module', ['rosbags.highlevel', 'surely_no_module'])
def test_the_module_of_an_error_is_named(module):
    name = module.partition('.')[0]
    assert missing_line(ModuleNotFoundError(f'No module named {module!r}', name=module)).startswith(
        f'{name} is not installed for ')
    assert missing_line(ImportError('libGL.so.1: no such file\n', name='cv2')) == 'libGL.so.1: no such file '


def without(module, monkeypatch):
    """As where it is not installed: what has been imported with it is imported anew."""
    for name in list(sys.modules):
        if name.startswith(('svdm_ros.bags.process.', 'svdm_ros.bags.images.', 'svdm_ros.bags.reading',
                            'svdm_ros.bags.writing')):
            monkeypatch.delitem(sys.modules, name)
        if name.partition('.')[0] == module:
            monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, 'meta_path', [Refusing(module), *sys.meta_path])
    importlib.invalidate_caches()


class Refusing:
    def __init__(self, module):
        self.module = module

    def find_spec(self, name, path=None, target=None):
        if name.partition('.')[0] == self.module:
            raise ModuleNotFoundError(f'No module named {name!r}', name=name)


@pytest.mark.parametrize(('command', 'arguments'), [
    (process_bag.main, ['a', 'b']), (images_to_bag.main, ['a', 'b', 'c', '--calib', 'd'])])
def test_the_commands_say_what_is_missing_in_one_line(command, arguments, monkeypatch, capsys):
    without('rosbags', monkeypatch)
    assert command(arguments) == 2
    [told] = capsys.readouterr().err.splitlines()
    assert ': rosbags is not installed for ' in told and "install 'rosbags>=0.11.9,<0.12'" in told


def test_svdm_says_so_too(monkeypatch, capsys):
    without('cv2', monkeypatch)
    assert cli.main(['match', 'a', 'b']) == 2
    [told] = capsys.readouterr().err.splitlines()
    assert told.startswith('svdm match: cv2 is not installed for ')
