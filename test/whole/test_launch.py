"""The launch files and layouts, as colcon installs them. Where there is no `ros2 launch`, a stand-in runs them."""
import importlib.util
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import rclpy
import yaml
from checkout import CHECKOUT
from node_bench import fresh_domain
from rcl_interfaces.srv import GetParameters
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import parameter_value_to_python
from rclpy.signals import SignalHandlerOptions
from stereo_msgs.msg import DisparityImage

DOMAIN = fresh_domain()
PRESETS = 'accurate, default, fast, paper, paper_start'
OUTPUTS = {
    'disparity', 'depth/image_rect', 'depth/camera_info', 'points2', 'confidence', 'disparity/preview',
    'disparity/preview/compressed', 'left/image_rect', 'diagnostics'}
RVIZ_CLASSES = {f'rviz_default_plugins/{name}' for name in (
    'PointCloud2', 'Image', 'MoveCamera', 'Select', 'FocusCamera', 'Measure', 'Orbit')} | {
    'rviz_common/Displays', 'rviz_common/Views', ''}
FOXGLOVE_PANELS = {'3D', 'Image', 'DiagnosticSummary', 'Parameters'}
LAUNCHER = ['ros2', 'launch'] if importlib.util.find_spec('ros2launch') and shutil.which('ros2') else [
    sys.executable, str(CHECKOUT / 'test' / 'support' / 'launch_stand_in.py')]


@pytest.fixture(scope='module')
def prefix(tmp_path_factory) -> Path:
    """The installation prefix of a build of these sources."""
    workspace = tmp_path_factory.mktemp('workspace')
    source = workspace / 'src' / 'svdm_ros'
    source.mkdir(parents=True)
    for name in ('svdm_core', 'svdm_ros', 'launch', 'config', 'resource'):
        shutil.copytree(CHECKOUT / name, source / name, ignore=shutil.ignore_patterns('__pycache__'))
    for name in ('package.xml', 'setup.py', 'setup.cfg', 'LICENSE'):
        shutil.copy2(CHECKOUT / name, source / name)
    subprocess.run([sys.executable, '-m', 'colcon', 'build'], cwd=workspace, check=True, capture_output=True,
                   timeout=100, env={**os.environ, 'COLCON_HOME': str(workspace / 'colcon')})
    return workspace / 'install' / 'svdm_ros'


class Launched:
    """A launch at work, and what it has printed."""

    def __init__(self, prefix: Path, folder: Path, file: str, *arguments: str) -> None:
        [site_packages] = prefix.glob('lib/python*/site-packages')
        environment = {
            **os.environ, 'PYTHONPATH': os.pathsep.join([str(site_packages), os.environ.get('PYTHONPATH', '')]),
            'AMENT_PREFIX_PATH': os.pathsep.join([str(prefix), os.environ.get('AMENT_PREFIX_PATH', '')]),
            'PATH': os.pathsep.join([str(Path(sys.executable).parent), os.environ['PATH']]),
            'ROS_LOG_DIR': str(folder), 'TMPDIR': str(folder), 'ROS_DOMAIN_ID': str(DOMAIN)}
        self._log = folder / 'launch.log'
        with self._log.open('w') as log:
            self.process = subprocess.Popen(
                [*LAUNCHER, str(prefix / 'share/svdm_ros/launch' / file), *arguments],
                cwd=folder, env=environment, stdout=log, stderr=subprocess.STDOUT, start_new_session=True)

    @property
    def output(self) -> str:
        return self._log.read_text()

    def stop(self) -> None:
        """The whole group, as Ctrl-C does."""
        if self.process.poll() is None:
            os.killpg(self.process.pid, signal.SIGINT)
            try:
                self.process.wait(10)
            except subprocess.TimeoutExpired:
                os.killpg(self.process.pid, signal.SIGKILL)
                self.process.wait()


@pytest.fixture
def launch(prefix, tmp_path) -> Iterator[Callable[..., Launched]]:
    """Starts a launch file of the installation; stopped at the end of the test."""
    launched = []

    def start(file: str, *arguments: str) -> Launched:
        launched.append(Launched(prefix, tmp_path, file, *arguments))
        return launched[-1]

    yield start
    for one in launched:
        one.stop()


class Observer:
    """A node that looks at what was launched."""

    def __init__(self) -> None:
        self._context = rclpy.Context()
        rclpy.init(context=self._context, domain_id=DOMAIN, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node('observer', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)

    def close(self) -> None:
        self._executor.shutdown()
        self._node.destroy_node()
        self._context.try_shutdown()

    def wait_for(self, launched: Launched, *nodes: str) -> None:
        end = time.monotonic() + 18
        while not set(nodes) <= {f'{place.rstrip("/")}/{name}'
                                 for name, place in self._node.get_node_names_and_namespaces()}:
            assert launched.process.poll() is None and time.monotonic() < end, launched.output
            time.sleep(0.1)

    def subscriptions(self, node: str) -> set[str]:
        """Topics of the images and infos that a node listens to, once there are all four."""
        namespace, _, name = node.rpartition('/')
        # Else the node takes no images.
        self._node.create_subscription(DisparityImage, f'{namespace}/disparity', lambda _: None, 1)
        end = time.monotonic() + 10
        while time.monotonic() < end:
            found = {topic for topic, kinds in self._node.get_subscriber_names_and_types_by_node(name, namespace or '/')
                     if kinds[0].startswith('sensor_msgs/')}
            if len(found) >= 4:
                return found
            time.sleep(0.1)
        return found

    def parameters(self, node: str, *names: str) -> list:
        client = self._node.create_client(GetParameters, f'{node}/get_parameters')
        assert client.wait_for_service(10)
        future = client.call_async(GetParameters.Request(names=list(names)))
        self._executor.spin_until_future_complete(future, 10)
        return [parameter_value_to_python(value) for value in future.result().values]


@pytest.fixture
def observer() -> Iterator[Observer]:
    observer = Observer()
    yield observer
    observer.close()


# What is started


def test_a_preset_by_name_and_arguments_reach_the_node(launch, observer):
    launched = launch('disparity.launch.py', 'params_file:=fast', 'use_sim_time:=Yes', 'namespace:=rig',
                      'approximate_sync_tolerance:=0.02', 'left_namespace:=/cam/l', 'right_image:=/cam/other')
    observer.wait_for(launched, '/rig/disparity_node')
    names = ('aggregation', 'use_sim_time', 'approximate_sync_tolerance')
    assert observer.parameters('/rig/disparity_node', *names) == ['box', True, 0.02]
    assert observer.subscriptions('/rig/disparity_node') >= {
        '/cam/l/image_rect', '/cam/l/camera_info', '/cam/other', '/rig/right/camera_info'}


def test_two_cameras_in_two_namespaces(launch, observer):
    launched = launch('two_cameras.launch.py', 'cameras:=front,rear', 'params_file:=fast')
    observer.wait_for(launched, '/front/disparity_node', '/rear/disparity_node')
    for camera in ('front', 'rear'):
        assert observer.subscriptions(f'/{camera}/disparity_node') >= {
            f'/{camera}/{side}/{topic}' for side in ('left', 'right') for topic in ('image_rect', 'camera_info')}


@pytest.mark.skipif(shutil.which('rviz2') is not None, reason='rviz2 is installed')
def test_stereo_starts_the_node_and_tells_where_rviz_is_missing(launch, observer, tmp_path):
    mine = tmp_path / 'mine.yaml'
    mine.write_text('/**: {ros__parameters: {paths: 3}}')
    launched = launch('stereo.launch.py', 'params_file:=mine.yaml')
    observer.wait_for(launched, '/disparity_node')
    assert observer.parameters('/disparity_node', 'paths') == [3]
    assert 'rviz2 is not installed: starting the node without it' in launched.output


# What is refused


@pytest.mark.parametrize(('file', 'arguments', 'line'), [
    ('disparity.launch.py', ['params_file:=/nowhere/mine.yaml'],
     f"params_file: no file '/nowhere/mine.yaml'. Give the path of a ROS parameter file, or a preset: {PRESETS}"),
    ('stereo.launch.py', ['params_file:=fats'],
     f"params_file: no preset 'fats'. Give the path of a ROS parameter file, or a preset: {PRESETS}"),
    ('disparity.launch.py', ['use_sim_time:=ture'],
     "use_sim_time: 'ture' is not allowed. Give one of: true, yes, 1, false, no, 0"),
    ('stereo.launch.py', ['rviz:=perhaps'], "rviz: 'perhaps' is not allowed. Give one of: true, yes, 1, false, no, 0"),
    ('disparity.launch.py', ['approximate_sync_tolerance:=often'],
     "approximate_sync_tolerance: 'often' is not a number"),
    ('disparity.launch.py', ['params_fil:=fast'],
     "unknown launch argument 'params_fil'. Did you mean params_file? Known are: "),
    ('two_cameras.launch.py', ['camera:=front'], "unknown launch argument 'camera'. Did you mean cameras? Known are: "),
])
def test_a_wrong_argument_is_one_line_and_an_exit_code(launch, file, arguments, line):
    launched = launch(file, *arguments)
    assert launched.process.wait(15) == 1
    [error] = [text for text in launched.output.splitlines() if 'ERROR' in text]
    assert line in error
    assert 'Traceback' not in launched.output
    assert 'disparity_node --ros-args' not in launched.output, 'nothing is started'


# What the launch files hand on, looked at without starting anything


@pytest.fixture
def launching(monkeypatch):
    """svdm_ros.launching on stand-ins for launch that record."""
    import launch_stand_in
    for name in ('launch', 'launch.actions', 'launch.substitutions', 'launch_ros', 'launch_ros.actions'):
        monkeypatch.setitem(sys.modules, name, None)
    launch_stand_in.install()
    monkeypatch.setattr(launch_stand_in, 'get_package_prefix', lambda package: f'/opt/{package}')
    spec = importlib.util.spec_from_file_location('svdm_ros.launching', CHECKOUT / 'svdm_ros' / 'launching.py')
    module = importlib.util.module_from_spec(spec)
    monkeypatch.setitem(sys.modules, 'svdm_ros.launching', module)
    spec.loader.exec_module(module)
    return module


def _given(launching, **values: str) -> dict[str, str]:
    arguments = {**launching.CAMERA_ARGUMENTS, **launching.NODE_ARGUMENTS, **launching.RVIZ_ARGUMENTS}
    assert values.keys() <= arguments.keys()
    return {name: default for name, (default, _) in arguments.items()} | values


@pytest.mark.parametrize('in_file', [False, True])
def test_raw_input_remaps_the_raw_images_and_leaves_the_rectified_ones_to_the_node(launching, tmp_path, in_file):
    mine = tmp_path / 'mine.yaml'
    mine.write_text('disparity_node: {ros__parameters: {input: raw}}')
    how = {'params_file': str(mine)} if in_file else {'input': 'raw'}
    rules = dict(launching.disparity_node(_given(launching, left_namespace='/cam/l', **how)).rules)
    assert rules['left/image_raw'] == '/cam/l/image_raw'
    assert rules['left/image_raw/compressed'] == '/cam/l/image_raw/compressed'
    assert rules['right/camera_info'] == 'right/camera_info'
    assert not any('image_rect' in name for name in rules)


def test_one_image_of_both_views_is_remapped_with_its_compressed_twin(launching):
    node = launching.disparity_node(_given(
        launching, image='/usb/image_raw', layout='side_by_side', input='raw', transport='compressed'))
    rules = dict(node.rules)
    assert rules['image_raw'] == '/usb/image_raw'
    assert rules['image_raw/compressed'] == '/usb/image_raw/compressed'
    assert node.parameters[1] == {'input': 'raw', 'transport': 'compressed', 'layout': 'side_by_side'}


def test_what_is_empty_is_left_to_the_parameter_file(launching):
    [file] = launching.disparity_node(_given(launching, params_file='paper')).parameters
    assert file.endswith('config/paper.yaml')


def test_rviz_is_started_with_the_layout_in_the_namespace_of_the_node(launching, monkeypatch):
    monkeypatch.setattr(launching, 'get_package_prefix', lambda package: f'/opt/{package}')
    [node] = launching.rviz(_given(launching, namespace='front', fixed_frame='lens', use_sim_time='1'))
    assert node.command[1:5] == ['-d', str(CHECKOUT / 'config' / 'stereo.rviz'), '-f', 'lens']
    assert node.parameters == [{'use_sim_time': True}]
    assert ('__ns', '/front') in node.rules
    assert set(launching.RVIZ_TOPICS) == {topic.lstrip('/') for topic in _rviz_topics()}
    assert launching.rviz(_given(launching, rviz='no')) == []


def test_a_fast_dds_profile_that_is_set_is_kept(launching, monkeypatch):
    [setting] = [entity for entity in launching.launch_description('a', {}, lambda given: []).entities
                 if type(entity).__name__ == 'SetEnvironmentVariable']
    monkeypatch.setenv(setting.name, '/mine.xml')
    assert setting.value.perform(None) == '/mine.xml'
    monkeypatch.delenv(setting.name)
    assert Path(setting.value.perform(None)) == CHECKOUT / 'config' / 'fastdds.xml'


def test_names_on_the_command_line_of_a_file_that_includes_this_one_are_not_judged(launching, monkeypatch):
    import launch_stand_in
    context = launch_stand_in.Context(['robot:=r2'])
    monkeypatch.setattr(sys, 'argv', ['ros2', 'launch', 'mine', 'robot.launch.py', 'robot:=r2'])
    launching.launch_description('/share/stereo.launch.py', {}, lambda given: []).visit(context)
    monkeypatch.setattr(sys, 'argv', ['ros2', 'launch', 'svdm_ros', 'stereo.launch.py', 'robot:=r2'])
    with pytest.raises(launching.LaunchArgumentError, match='robot'):
        launching.launch_description('/share/stereo.launch.py', {}, lambda given: []).visit(context)


# The layouts


def _rviz_layout() -> dict:
    return yaml.safe_load((CHECKOUT / 'config' / 'stereo.rviz').read_text())


def _rviz_topics() -> list[str]:
    return [display['Topic']['Value'] for display in _rviz_layout()['Visualization Manager']['Displays']]


def _values(document, key: str) -> Iterator:
    """Everything that stands under `key`, at any depth."""
    children = document.items() if isinstance(document, dict) else enumerate(document) \
        if isinstance(document, list) else ()
    for name, child in children:
        if name == key:
            yield child
        yield from _values(child, key)


def test_rviz_layout_shows_topics_of_the_node_in_classes_that_rviz_has():
    layout = _rviz_layout()
    assert {'/points2', '/depth/image_rect', '/disparity/preview'} == set(_rviz_topics())
    assert {topic.lstrip('/') for topic in _rviz_topics()} <= OUTPUTS
    assert set(_values(layout, 'Class')) <= RVIZ_CLASSES
    assert {topic['Reliability Policy'] for topic in _values(layout, 'Topic')} == {'Reliable'}
    assert layout['Visualization Manager']['Global Options']['Fixed Frame']


def test_foxglove_layout_shows_topics_of_the_node_in_panels_that_foxglove_has():
    document = json.loads((CHECKOUT / 'config' / 'foxglove.json').read_text())
    panels = document['configById']
    assert {name.partition('!')[0] for name in panels} == FOXGLOVE_PANELS
    placed = [*_values(document['layout'], 'first'), *_values(document['layout'], 'second')]
    assert sorted(place for place in placed if isinstance(place, str)) == sorted(panels)
    topics = {topic for key in ('imageTopic', 'calibrationTopic', 'topicToRender') for topic in _values(panels, key)}
    topics |= {topic for shown in _values(panels, 'topics') for topic in shown}
    assert '/points2' in topics
    assert {topic.lstrip('/') for topic in topics} <= OUTPUTS


# The pages


@pytest.mark.parametrize('page', ['README.md', 'docs/node.md', 'docs/cameras.md'])
def test_launch_commands_in_the_pages_give_arguments_that_exist(launching, page):
    text = (CHECKOUT / page).read_text().replace('\\\n', ' ')
    commands = re.findall(r'ros2 launch svdm_ros (\w+)\.launch\.py(.*)', text)
    assert commands
    common = {**launching.CAMERA_ARGUMENTS, **launching.NODE_ARGUMENTS}
    known = {'disparity': common, 'stereo': {**common, **launching.RVIZ_ARGUMENTS},
             'two_cameras': {**launching.NODE_ARGUMENTS, 'cameras': ''}}
    for file, rest in commands:
        assert {name for name in re.findall(r'(\w+):=', rest)} <= known[file].keys(), (file, rest)


def test_links_of_the_pages_lead_to_headings_that_exist():
    for page in ('node.md', 'cameras.md'):
        text = (CHECKOUT / 'docs' / page).read_text()
        for target, heading in re.findall(r'\]\(([^)#:]*)#([^)]+)\)', text):
            other = (CHECKOUT / 'docs' / (target or page)).read_text()
            titles = [title.lower() for title in re.findall(r'^#+ (.+)$', other, re.MULTILINE)]
            assert heading in {re.sub(r'[^a-z0-9 _-]', '', title).replace(' ', '-') for title in titles}, heading
