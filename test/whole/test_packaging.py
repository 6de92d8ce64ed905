"""The package as others get it: built by colcon, and cloned onto a machine that has nothing yet."""
import ast
import contextlib
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

import pytest
from catkin_pkg.package import parse_package
from checkout import CHECKOUT
from node_bench import Client, fresh_domain

from svdm_core.kernels.cache import cache_folder

VERSION = ElementTree.parse(CHECKOUT / 'package.xml').findtext('version')
ROS_LIBRARIES = ('rclpy', 'launch', 'launch_ros')
PRESETS = ('accurate.yaml', 'default.yaml', 'fast.yaml', 'paper.yaml', 'paper_start.yaml')
TEMPLATES = ('evaluation/templates/evaluation.html.jinja', 'tuning/templates/tuning.html.jinja',
             'tuning/templates/proof.html.jinja')


def _copy_checkout(target: Path) -> Path:
    """What a clone would hold once everything here is committed."""
    names = subprocess.run(
        ['git', 'ls-files', '-z', '--cached', '--others', '--exclude-standard'],
        cwd=CHECKOUT, check=True, capture_output=True, text=True).stdout.split('\0')
    for name in filter(None, names):
        if (CHECKOUT / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copy2(CHECKOUT / name, target / name)
    return target


KERNELS = str(cache_folder().parent)
"""Those of this checkout serve its copies."""


def _outside_environment(**extra: str) -> dict[str, str]:
    """The environment without what this test run, or the ROS wheels it runs on, has put into it."""
    own = ('PYTHONPATH', 'LD_LIBRARY_PATH', '_ROS_WHEELS_BOOTSTRAP_COMPLETE', 'AMENT_PREFIX_PATH',
           'MAKEFLAGS', 'MAKELEVEL', 'MFLAGS', 'ARGS')
    return {key: value for key, value in os.environ.items() if key not in own} | extra


# What the files say


def test_manifest_is_valid_without_a_warning():
    warnings: list[str] = []
    package = parse_package(str(CHECKOUT), warnings=warnings)
    assert warnings == []
    assert (package.package_format, package.name, package.licenses) == (3, 'svdm_ros', ['Apache-2.0'])
    assert package.get_build_type() == 'ament_python'


def test_manifest_names_every_ros_package_that_is_imported():
    depends = {depend.name for depend in parse_package(str(CHECKOUT)).exec_depends}
    ros = {name for name in _imported_packages() if name.endswith(('_msgs', '_interfaces')) or name in ROS_LIBRARIES}
    assert {'rclpy', 'stereo_msgs'} <= ros
    assert ros <= depends


def _imported_packages() -> set[str]:
    sources = [*CHECKOUT.glob('svdm_*/**/*.py'), *CHECKOUT.glob('launch/*.py')]
    nodes = [node for source in sources for node in ast.walk(ast.parse(source.read_text()))]
    imported = {alias.name for node in nodes if isinstance(node, ast.Import) for alias in node.names}
    imported |= {node.module for node in nodes if isinstance(node, ast.ImportFrom) and node.module and node.level == 0}
    return {name.partition('.')[0] for name in imported}


def test_changelog_has_the_version():
    assert f'## {VERSION}' in (CHECKOUT / 'CHANGELOG.md').read_text()


@pytest.mark.parametrize('name', ['requirements-dev.txt', 'requirements-uv.txt'])
def test_pins_are_versions_with_hashes_and_name_no_index(name):
    text = (CHECKOUT / name).read_text().replace('\\\n', '')
    pins = text.splitlines()
    assert pins
    for pin in pins:
        assert re.fullmatch(r'[a-z0-9-]+==[^ ]+( ; [^\\]+?)?( +--hash=sha256:[0-9a-f]{64})+ *', pin), pin[:80]


def test_every_direct_requirement_is_pinned():
    wanted = re.findall(r'^[A-Za-z][\w-]*', (CHECKOUT / 'requirements-dev.in').read_text(), re.MULTILINE)
    pinned = re.findall(r'^[a-z0-9-]+(?===)', (CHECKOUT / 'requirements-dev.txt').read_text(), re.MULTILINE)
    assert {name.lower() for name in wanted} <= set(pinned)


# colcon build, as ROS users do it


@pytest.fixture(scope='module')
def prefix(tmp_path_factory) -> Path:
    """The installation prefix of a build in a clean workspace."""
    workspace = tmp_path_factory.mktemp('workspace')
    _copy_checkout(workspace / 'src' / 'svdm_ros')
    build = subprocess.run(
        [sys.executable, '-m', 'colcon', 'build'], cwd=workspace, capture_output=True, text=True, timeout=100,
        env={**os.environ, 'COLCON_HOME': str(workspace / 'colcon')})
    assert build.returncode == 0, build.stdout + build.stderr
    assert 'email' not in build.stderr.lower(), 'an invalid maintainer drops the ament hook'
    return workspace / 'install' / 'svdm_ros'


@pytest.mark.parametrize('path', [
    *(f'lib/svdm_ros/{executable}' for executable in (
        'disparity_node', 'process_bag', 'play_bag', 'images_to_bag', 'tuner')),
    'share/ament_index/resource_index/packages/svdm_ros',
    'share/svdm_ros/package.xml',
    *(f'share/svdm_ros/config/{name}' for name in ('fastdds.xml', 'stereo.rviz', 'foxglove.json')),
    *(f'share/svdm_ros/config/{preset}' for preset in PRESETS),
    *(f'share/svdm_ros/launch/{name}.launch.py' for name in ('disparity', 'stereo', 'two_cameras')),
    *(f'lib/python3.12/site-packages/svdm_core/{template}' for template in TEMPLATES),
    'lib/python3.12/site-packages/svdm_ros/tuner/page.css',
    *(f'share/svdm_ros/hook/ament_prefix_path.{kind}' for kind in ('dsv', 'sh')),
])
def test_colcon_installs(prefix, path):
    assert (prefix / path).is_file()


def test_installed_config_is_complete_and_the_node_executable(prefix):
    source = {path.name: path.read_bytes() for path in (CHECKOUT / 'config').glob('*.*')}
    assert {path.name: path.read_bytes() for path in (prefix / 'share/svdm_ros/config').iterdir()} == source
    assert os.access(prefix / 'lib/svdm_ros/disparity_node', os.X_OK)


def test_the_installed_node_heeds_signals_before_it_imports_anything_that_takes_time(prefix):
    [scripts] = prefix.glob('lib/python*/site-packages/svdm_ros-*.egg-info/entry_points.txt')
    assert 'disparity_node = svdm_ros.__main__:main' in scripts.read_text().splitlines()
    modules = ', '.join(f'svdm_ros.{name}' for name in (
        '__main__', 'bags.play_bag', 'bags.images_to_bag', 'bags.process_bag'))
    code = f'import sys, {modules}; print({{"rclpy", "numba", "numpy", "cv2", "rosbags"}} & set(sys.modules))'
    run = subprocess.run([sys.executable, '-c', code], cwd=CHECKOUT, capture_output=True, text=True, timeout=60)
    assert run.stdout == 'set()\n', run.stderr


@pytest.fixture
def installed_environment(prefix, tmp_path) -> dict[str, str]:
    """As after sourcing the workspace: the installation alone, not this checkout."""
    [site_packages] = prefix.glob('lib/python*/site-packages')
    return {
        **os.environ,
        'PYTHONPATH': str(site_packages),
        'AMENT_PREFIX_PATH': str(prefix),
        'ROS_LOG_DIR': str(tmp_path),
        'ROS_DOMAIN_ID': str(fresh_domain()),
        'NUMBA_CACHE_DIR': KERNELS,
        'FASTRTPS_DEFAULT_PROFILES_FILE': str(prefix / 'share/svdm_ros/config/fastdds.xml'),
    }


def test_installed_package_is_found_with_its_presets(prefix, installed_environment, tmp_path):
    code = '''
import svdm_core, svdm_ros.node.disparity_node, svdm_core.presets
from ament_index_python.packages import get_package_prefix
places = svdm_core.__file__, svdm_ros.__file__, svdm_core.presets.preset_folder()
print(get_package_prefix("svdm_ros"), *places, sep="\\n")
print(*svdm_core.preset_names())'''
    run = subprocess.run([sys.executable, '-c', code], cwd=tmp_path, env=installed_environment,
                         capture_output=True, text=True, timeout=60)
    assert run.returncode == 0, run.stderr
    *places, names = run.stdout.splitlines()
    assert all(Path(place).is_relative_to(prefix) for place in places)
    assert {f'{name}.yaml' for name in names.split()} >= set(PRESETS)


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_installed_node_runs_until_interrupted(prefix, installed_environment, tmp_path):
    log = tmp_path / 'node.log'
    with log.open('w') as output:
        node = subprocess.Popen(
            [sys.executable, str(prefix / 'lib/svdm_ros/disparity_node'), '--ros-args',
             '--params-file', str(prefix / 'share/svdm_ros/config/default.yaml')],
            cwd=tmp_path, env=installed_environment, stdout=output, stderr=subprocess.STDOUT)
    client = Client(int(installed_environment['ROS_DOMAIN_ID']))
    try:
        client.spin_until(lambda: client.hears_of_a_ready_node() or node.poll() is not None, 'ready', limit=100)
        assert node.poll() is None, log.read_text()
        node.send_signal(signal.SIGINT)
        assert node.wait(10) == 0, log.read_text()
    finally:
        client.close()
        node.kill()
    assert 'unknown parameter' not in log.read_text()


# A fresh clone


@pytest.fixture(scope='module')
def clone(tmp_path_factory) -> Path:
    """Everything but what make sets up, in a folder whose name has a space."""
    return _copy_checkout(tmp_path_factory.mktemp('fresh clone'))


@pytest.fixture(scope='module')
def demo(tmp_path_factory) -> Iterator[tuple[Path, subprocess.Popen, Path]]:
    """`make demo` at work in a clone of its own: the clone, the process, and what it prints."""
    clone = _copy_checkout(tmp_path_factory.mktemp('demo clone'))
    log = clone.with_suffix('.log')
    with log.open('w') as output:
        process = subprocess.Popen(
            ['make', 'demo', 'ARGS=--frames 2'], cwd=clone, stdout=output,
            env=_outside_environment(PATH=_path_with_uv(), NUMBA_CACHE_DIR=KERNELS),
            stderr=subprocess.STDOUT, start_new_session=True)
    yield clone, process, log
    for number in (signal.SIGTERM, signal.SIGKILL):  # in order first: its node and camera are in groups of their own
        end = time.monotonic() + 20
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, number)
            while time.monotonic() < end:
                process.poll()
                os.killpg(process.pid, 0)
                time.sleep(0.05)


def _path_with_uv() -> str:
    """PATH with the uv that set up this checkout, so that nothing is fetched twice."""
    return os.pathsep.join([str(CHECKOUT / '.tools' / 'bin'), os.environ['PATH']])


def _make(clone: Path, *arguments: str, path: str | None = None, timeout: float = 60) -> subprocess.CompletedProcess:
    environment = _outside_environment(**({} if path is None else {'PATH': path}))
    return subprocess.run(
        ['make', *arguments], cwd=clone, env=environment, capture_output=True, text=True, timeout=timeout)


def test_make_alone_tells_the_targets(clone):
    run = _make(clone)
    assert run.returncode == 0
    told = re.findall(r'^  make (\w+) ', run.stdout, re.MULTILINE)
    assert told == ['help', 'demo', 'tuner', 'test', 'lint', 'soak', 'pins', 'clean']


def test_make_says_in_one_line_that_python_is_missing(clone, tmp_path):
    for tool in ('sh', 'make', 'uname', 'awk'):
        (tmp_path / tool).symlink_to(shutil.which(tool))
    run = _make(clone, 'demo', path=str(tmp_path))
    assert run.returncode != 0
    assert run.stderr.splitlines()[0] == (
        'make: no Python 3.12 found (tried python3.12, python3, python): install python3.12 and put it on PATH')
    assert not (clone / '.venv').exists()


def test_make_test_sets_up_first_and_ends_with_pytest(clone):
    planned = _make(clone, '--dry-run', 'test').stdout
    steps = [planned.index(step) for step in ('requirements-uv.txt', 'pip sync', 'ruff check', '-m mypy', '-m pytest')
             if step != 'requirements-uv.txt' or shutil.which('uv') is None]
    assert steps == sorted(steps)
    assert ' -m pytest ' in planned.strip().splitlines()[-1]


def test_ci_runs_make_test_and_nothing_else():
    script = (CHECKOUT / '.ci' / 'run').read_text()
    assert os.access(CHECKOUT / '.ci' / 'run', os.X_OK)
    assert script.strip().splitlines()[-1] == 'exec make test'


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_make_demo_in_a_fresh_clone(demo):
    clone, process, log = demo
    assert process.wait(280) == 0, log.read_text()
    assert 'setting up .venv' in log.read_text()
    assert all((clone / 'demo_output' / name).is_file() for name in ('comparison.png', 'depth.png'))
    assert 'setting up' not in _make(clone, '--dry-run', 'demo', path=_path_with_uv()).stdout
