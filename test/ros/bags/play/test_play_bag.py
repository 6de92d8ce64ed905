"""play_bag as a process of its own: what arrives over DDS, when, with which QoS, and what the node makes of it."""
import contextlib
import itertools
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
import rclpy
from checkout import CHECKOUT
from diagnostic_msgs.msg import DiagnosticArray, KeyValue
from node_bench import NodeProcess, camera_info, fresh_domain, image_message, random_dots
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rclpy.serialization import serialize_message
from rclpy.signals import SignalHandlerOptions
from rosbags.highlevel import AnyReader
from rosbags.interfaces import Qos, QosDurability, QosHistory, QosLiveliness, QosReliability, QosTime
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosgraph_msgs.msg import Clock
from sensor_msgs.msg import CameraInfo, Image
from std_msgs.msg import String
from stereo_msgs.msg import DisparityImage

SIDES = ('left', 'right')
FIRST, PERIOD = 1_700_000_000 * 10**9, 50_000_000
LIMIT = 30.0
STORE = get_typestore(Stores.ROS2_JAZZY)
FOREVER = QosTime(9223372036, 854775807)
TYPES = {'image_rect': Image, 'camera_info': CameraInfo, 'disparity': DisparityImage, 'clock': Clock}
RELIABLE = QoSProfile(depth=50, reliability=ReliabilityPolicy.RELIABLE)
BEST_EFFORT = QoSProfile(depth=50, reliability=ReliabilityPolicy.BEST_EFFORT)  # whom the player need not wait for


def offered(reliability='RELIABLE', durability='VOLATILE', depth=1):
    return [Qos(QosHistory.KEEP_LAST, depth, QosReliability[reliability], QosDurability[durability], FOREVER, FOREVER,
                QosLiveliness.AUTOMATIC, FOREVER, False)]


def stereo_messages(pairs):
    """(topic, type, time in ns, message) of `pairs` random-dot pairs; recorded 3 ms after their stamps."""
    for number in range(pairs):
        stamp = FIRST + number * PERIOD
        for side, pixels in zip(SIDES, random_dots(seed=number), strict=True):
            for name, message in (('camera_info', camera_info(side)), ('image_rect', image_message(pixels))):
                message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
                yield f'/{side}/{name}', TYPES[name], stamp + 3_000_000, message


def write_bag(folder, messages, qos=None, store=STORE):
    """A rosbag2 in mcap; `qos` by topic, none recorded for the others."""
    with Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        connections = {}
        for topic, kind, stamp, message in messages:
            name = kind if isinstance(kind, str) else f'{kind.__module__.split(".")[0]}/msg/{kind.__name__}'
            if topic not in connections:
                connections[topic] = writer.add_connection(
                    topic, name, typestore=store, offered_qos_profiles=(qos or {}).get(topic, ()))
            data = message if isinstance(message, bytes) else serialize_message(message)
            writer.write(connections[topic], stamp, data)
    return folder


@pytest.fixture(scope='module')
def stereo_bag(tmp_path_factory):
    return write_bag(tmp_path_factory.mktemp('recording') / 'bag', stereo_messages(6))


class Listener:
    """Takes the raw bytes of topics; received: (topic, monotonic time in s, bytes) in order of arrival."""

    def __init__(self, domain):
        self._context = Context()
        rclpy.init(context=self._context, domain_id=domain, signal_handler_options=SignalHandlerOptions.NO)
        self.node = rclpy.create_node('listener', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self.node)
        self.received = []

    def listen(self, topic, kind, qos=BEST_EFFORT, raw=True):
        def take(data):
            self.received.append((topic, time.monotonic(), data))

        self.node.create_subscription(kind, topic, take, qos, raw=raw)

    def spin_while(self, condition, limit=LIMIT):
        end = time.monotonic() + limit
        while condition():
            assert time.monotonic() < end, f'not within {limit} s; {Counter(topic for topic, *_ in self.received)}'
            self._executor.spin_once(timeout_sec=0.02)

    def of(self, topic):
        return [entry for entry in self.received if entry[0] == topic]

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()
        self._context.try_shutdown()


@contextlib.contextmanager
def listening():
    listener = Listener(fresh_domain_of_test())
    try:
        yield listener
    finally:
        listener.close()


_domain = []


def fresh_domain_of_test():
    """Also that of the processes `Playing` starts from now on."""
    _domain[:] = [fresh_domain()]
    return _domain[0]


class Playing:
    """`python -m svdm_ros.bags.play_bag` in the domain of the test."""

    def __init__(self, *arguments):
        self.process = subprocess.Popen(
            [sys.executable, '-m', 'svdm_ros.bags.play_bag', *map(str, arguments)], cwd=CHECKOUT, text=True,
            stdout=subprocess.PIPE, stderr=subprocess.PIPE, env={**os.environ, 'ROS_DOMAIN_ID': str(_domain[0])})

    def runs(self):
        return self.process.poll() is None

    def end(self):
        """Exit code, standard output, standard error, once it has ended."""
        out, error = self.process.communicate(timeout=LIMIT)
        return self.process.returncode, out, error

    def kill(self):
        self.process.kill()
        self.process.communicate()


@contextlib.contextmanager
def playing(*arguments):
    play = Playing(*arguments)
    try:
        yield play
    finally:
        play.kill()


def play_to(listener, *arguments):
    """Play to the end with `listener` taking it; exit code, standard output and standard error."""
    with playing(*arguments) as play:
        listener.spin_while(play.runs)
        return play.end()


def stamp_of(data):
    """ns, of the header at the begin of a CDR message."""
    second, nanosecond = np.frombuffer(data[4:12], np.uint32).tolist()
    return second * 10**9 + nanosecond


# What arrives


class DisturbedError(AssertionError):
    """Times that are not the player's, unless they come again."""


def in_time(holds):
    if not holds:
        raise DisturbedError


def undisturbed(attempt):
    """Times are the player's where nothing else has the processors: one of three attempts has to meet them."""
    for _ in range(2):
        try:
            return attempt()
        except DisturbedError:
            continue
    return attempt()


def test_the_bytes_of_the_recording_arrive_in_its_time_and_pass_after_pass(stereo_bag):
    undisturbed(lambda: check_bytes_and_times(stereo_bag))


def check_bytes_and_times(stereo_bag):
    with AnyReader([stereo_bag]) as reader:
        recorded = [(connection.topic, bytes(data)) for connection, _, data in reader.messages()]
    assert len(recorded) == 24
    with listening() as listener:
        for topic in {topic for topic, _ in recorded}:
            listener.listen(topic, TYPES[topic.rpartition('/')[2]])
        code, out, error = play_to(listener, stereo_bag, '--loop', '2', '--rate', '0.5', '--wait-for-subscribers')
        assert (code, error) == (0, '')
        assert 'played 48 messages, 2 whole passes; ' in out
        for topic in {topic for topic, _ in recorded}:
            one_pass = [data for name, data in recorded if name == topic]
            arrived = [data for _, _, data in listener.of(topic)]
            # DDS fills the last four bytes up.
            assert [data[:len(one_pass[0])] for data in arrived] == 2 * one_pass
            assert all(0 <= len(data) - len(one_pass[0]) < 4 for data in arrived)
        # One pass follows the other without a gap: 12 periods of 100 ms, but for what the machine adds.
        times = [moment for _, moment, _ in listener.of('/right/image_rect')]
        in_time(times[-1] - times[0] == pytest.approx(11 * 0.1, abs=0.08))
        in_time(np.median(np.diff(times)) == pytest.approx(0.1, abs=0.03))


def test_the_clock_is_that_of_the_recording_and_jumps_back_with_a_loop(stereo_bag):
    undisturbed(lambda: check_clock(stereo_bag))


def check_clock(stereo_bag):
    with listening() as listener:
        listener.listen('/clock', Clock)
        listener.listen('/left/camera_info', CameraInfo)
        code, _, error = play_to(listener, stereo_bag, '--topics', 'left/camera_info', '--clock', '100', '--loop', '2',
                                 '--rate', '0.5', '--wait-for-subscribers')
        assert (code, error) == (0, '')
        moments = [(moment, stamp_of(data)) for _, moment, data in listener.of('/clock')]
        in_time(len(moments) > 80)  # of 120
        steps = np.diff([stamp for _, stamp in moments])
        assert (steps < 0).sum() == 1
        assert all(FIRST <= stamp <= FIRST + 6.5 * PERIOD for _, stamp in moments)
        assert np.median(steps) == pytest.approx(5e6, rel=0.3)
        # A message comes when the clock shows the time it was recorded, within a tick and what the machine adds.
        for _, moment, data in listener.of('/left/camera_info'):
            shown = [stamp for when, stamp in moments if when <= moment][-1:]
            in_time(not shown or abs(shown[0] - stamp_of(data) - 3e6) < 25e6 or shown[0] > FIRST + 5 * PERIOD)


def test_a_part_of_some_topics(stereo_bag):
    with listening() as listener:
        for side in SIDES:
            listener.listen(f'/elsewhere/{side}', Image)
            listener.listen(f'/{side}/camera_info', CameraInfo)
        code, out, _ = play_to(listener, stereo_bag, '--topics', '/left/image_rect', 'right/image_rect', '--start',
                               '0.1', '--duration', '0.15', '--wait-for-subscribers', '--ros-args',
                               '-r', '/left/image_rect:=/elsewhere/left', '-r', '/right/image_rect:=/elsewhere/right')
        assert code == 0
        assert 'played 6 messages' in out
        for side in SIDES:
            stamps = [stamp_of(data) for _, _, data in listener.of(f'/elsewhere/{side}')]
            assert stamps == [FIRST + n * PERIOD for n in (2, 3, 4)]
        assert {topic for topic, *_ in listener.received} == {'/elsewhere/left', '/elsewhere/right'}


def test_qos_is_what_was_offered(tmp_path):
    kinds = {
        '/latched': offered(durability='TRANSIENT_LOCAL'), '/lossy': offered('BEST_EFFORT'),
        '/both': offered() + offered('BEST_EFFORT'), '/deep': offered(depth=70), '/unknown': offered('UNKNOWN'),
        '/tf_static': (), '/plain': (),
    }
    expected = {'/latched': ('RELIABLE', 'TRANSIENT_LOCAL', 10), '/lossy': ('BEST_EFFORT', 'VOLATILE', 10),
                '/both': ('RELIABLE', 'VOLATILE', 10), '/deep': ('RELIABLE', 'VOLATILE', 70),
                '/unknown': ('RELIABLE', 'VOLATILE', 10), '/tf_static': ('RELIABLE', 'TRANSIENT_LOCAL', 10),
                '/plain': ('RELIABLE', 'VOLATILE', 10)}
    messages = [(topic, String, FIRST, String(data=topic)) for topic in kinds]
    messages.append(('/plain', String, FIRST + 10 * 10**9, String(data='later')))
    bag = write_bag(tmp_path / 'bag', messages, kinds)
    with listening() as listener, playing(bag) as play:
        seen = {}

        def all_seen():
            for topic in kinds:
                for info in listener.node.get_publishers_info_by_topic(topic):
                    qos = info.qos_profile
                    seen[topic] = (qos.reliability.name, qos.durability.name)
            return len(seen) == len(kinds)

        listener.spin_while(lambda: not all_seen())
        assert seen == {topic: values[:2] for topic, values in expected.items()}
        # Who comes late gets what is latched.
        latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        listener.listen('/latched', String, latched, raw=False)
        listener.spin_while(lambda: not listener.received)
        assert listener.received[0][2].data == '/latched'
        assert play.runs()
    from svdm_ros.bags.play.publishers import played_qos  # depths do not travel over DDS
    from svdm_ros.bags.reading.recording import open_recording
    with open_recording(bag) as recording:
        assert {name: played_qos(topic).depth for name, topic in recording.topics.items()} == {
            name: depth for name, (_, _, depth) in expected.items()}


def test_types_that_cannot_be_published_are_left_out_and_told(tmp_path):
    """One of a package that is not installed, one recorded with other fields; the rest is played."""
    other = get_typestore(Stores.EMPTY)
    other.register(get_types_from_msg('int32 number\n', 'lidar_msgs/msg/Scan'))
    other.register(get_types_from_msg('string data\nstring unit\n', 'std_msgs/msg/String'))
    other.register(get_types_from_msg('bool data\n', 'std_msgs/msg/Bool'))
    messages = [('/scan', 'lidar_msgs/msg/Scan', FIRST, b'\0\1\0\0\5\0\0\0'),
                ('/name', 'std_msgs/msg/String', FIRST, serialize_message(String(data='x'))),
                ('/flag', 'std_msgs/msg/Bool', FIRST, b'\0\1\0\0\1')]
    bag = write_bag(tmp_path / 'bag', messages, store=other)
    with listening() as listener:
        code, out, error = play_to(listener, bag)
    assert code == 0
    assert 'played 1 messages' in out
    assert sorted(error.splitlines()) == [
        'play_bag: left out: /name: its std_msgs/msg/String was recorded with other fields than the one installed has',
        'play_bag: left out: /scan: lidar_msgs/msg/Scan is not installed']


def test_a_ros1_bag_is_played_as_ros2(tmp_path):
    ros1 = get_typestore(Stores.ROS1_NOETIC)
    kind = ros1.types['sensor_msgs/msg/Image']
    header = ros1.types['std_msgs/msg/Header'](7, ros1.types['builtin_interfaces/msg/Time'](12, 345), 'camera')
    pixels = np.arange(60, dtype=np.uint8)
    with Ros1Writer(tmp_path / 'old.bag') as writer:
        connection = writer.add_connection('/left/image_rect', 'sensor_msgs/msg/Image', typestore=ros1)
        image = kind(header, 6, 10, 'mono8', 0, 10, pixels)
        writer.write(connection, FIRST, ros1.serialize_ros1(image, 'sensor_msgs/msg/Image'))
    with listening() as listener:
        listener.listen('/left/image_rect', Image, raw=False)
        code, _, error = play_to(listener, tmp_path / 'old.bag', '--wait-for-subscribers')
        assert (code, error) == (0, '')
        [(_, _, message)] = listener.received
    assert (message.height, message.width, message.encoding, message.header.frame_id) == (6, 10, 'mono8', 'camera')
    assert (message.header.stamp.sec, message.header.stamp.nanosec) == (12, 345)
    assert bytes(message.data) == pixels.tobytes()


# The live node


def wait_until_ready(listener):
    told = []
    listener.node.create_subscription(DiagnosticArray, '/diagnostics', told.append, 10)
    ready = KeyValue(key='state', value='ready')
    listener.spin_while(lambda: not any(ready in message.status[0].values for message in told), limit=100.0)


def test_every_pair_of_each_pass_comes_out_of_the_live_node(stereo_bag, tmp_path):
    with listening() as listener:
        node = NodeProcess(_domain[0], tmp_path / 'node.log', '-p', 'num_disparities:=16',
                           FASTRTPS_DEFAULT_PROFILES_FILE=str(CHECKOUT / 'config' / 'fastdds.xml'))
        try:
            listener.listen('disparity', DisparityImage, RELIABLE, raw=False)
            wait_until_ready(listener)
            listener.spin_while(lambda: listener.node.count_publishers('disparity') == 0)
            code, out, error = play_to(listener, stereo_bag, '--loop', '3', '--rate', '0.2', '--wait-for-subscribers')
            assert (code, error) == (0, '')
            assert 'played 72 messages, 3 whole passes' in out
            with contextlib.suppress(AssertionError):  # the last one may still be on its way
                listener.spin_while(lambda: len(listener.received) < 18, limit=5.0)
        finally:
            node.kill()
        messages = [message for _, _, message in listener.received]
    stamps = [message.header.stamp.sec * 10**9 + message.header.stamp.nanosec for message in messages]
    assert stamps == 3 * [FIRST + n * PERIOD for n in range(6)]
    assert all(message.f == 100.0 and message.t == pytest.approx(0.2) for message in messages)
    for first, later in itertools.pairwise((messages[:6], messages[6:12], messages[12:])):
        assert [message.image.data for message in later] == [message.image.data for message in first]


# How it ends


def test_a_long_wait_is_told_with_how_to_skip_it(tmp_path):
    early = ('/early', String, FIRST - 3600 * 10**9, String(data='x'))
    bag = write_bag(tmp_path / 'bag', [early, *stereo_messages(2)])
    with listening() as listener:
        with playing(bag) as play:
            line = play.process.stdout.readline()
            play.process.send_signal(signal.SIGINT)
            play.end()
        code, out, _ = play_to(listener, bag, '--start', '3600.003')
    assert line.startswith('nothing for 3600 s: the next message, on /left/camera_info, was recorded 3600.003 s after')
    assert '--start 3600.003 begins with it' in line
    assert (code, out.partition(',')[0]) == (0, 'played 8 messages')


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_an_endless_loop_with_exit_code_0(stereo_bag, number):
    with listening() as listener, playing(stereo_bag, '--loop', '--rate', '5') as play:
        listener.listen('/left/camera_info', CameraInfo)
        listener.spin_while(lambda: len(listener.received) < 20)
        play.process.send_signal(number)
        code, out, error = play.end()
    assert (code, error) == (0, '')
    assert out.rstrip().endswith(', interrupted')


@pytest.mark.parametrize('delay', [0.1, 0.6, 1.2, None])
def test_a_signal_ends_it_with_exit_code_0_at_any_moment(stereo_bag, delay):
    """While it starts, and while it waits for subscribers, of whom there is none."""
    fresh_domain_of_test()
    with playing(stereo_bag, '--wait-for-subscribers') as play:
        if delay is None:
            assert play.process.stdout.readline() == 'waiting for a subscriber\n'
        else:
            time.sleep(delay)
            end = time.monotonic() + LIMIT
            while not _catches_sigint(play.process.pid):
                assert play.runs() and time.monotonic() < end
                time.sleep(0.001)
        play.process.send_signal(signal.SIGINT)
        code, _, error = play.end()
    assert (code, error) == (0, '')


def _catches_sigint(pid):
    """Its own handler, or Python's, which it has from its start: what counts is SIGTERM, which Python leaves alone."""
    status = Path(f'/proc/{pid}/status').read_text()
    mask = int(next(line for line in status.splitlines() if line.startswith('SigCgt')).split()[1], 16)
    return mask >> (signal.SIGTERM - 1) & 1


def play_here(*arguments):
    """Refused before anything of ROS is started, so no process of its own is needed."""
    from svdm_ros.bags.play.playback import play
    from svdm_ros.bags.play_bag import _parse

    return play(*_parse(list(map(str, arguments))))


def test_what_cannot_be_played_is_told_in_one_line(stereo_bag, tmp_path, capsys):
    empty = write_bag(tmp_path / 'empty', [])
    (tmp_path / 'cut.mcap').write_bytes((stereo_bag / 'bag.mcap').read_bytes()[:30_000])
    told = {
        (tmp_path / 'nowhere',): 'nowhere: there is no such file or folder',
        (tmp_path / 'cut.mcap',): 'cut.mcap: the file is cut off',
        (empty,): 'empty: no message in it',
        (stereo_bag, '--topics', 'left/image'): 'there is no topic left/image; there are /left/camera_info, /left/ima',
        (stereo_bag, '--start', '3'): '--start 3 is not allowed: the recording is 0.250 s long',
    }
    for arguments, text in told.items():
        assert play_here(*arguments) == 2
        [line] = capsys.readouterr().err.splitlines()
        assert line.startswith('play_bag: ')
        assert text in line


@pytest.mark.parametrize('arguments', [['--rate', '0'], ['--rate', 'inf'], ['--loop', '0'], ['--loop', '1.5'],
                                       ['--clock', '-1'], ['--start', '-1'], ['--duration', '0'], ['--topics']])
def test_values_that_are_not_allowed(stereo_bag, arguments):
    with pytest.raises(SystemExit) as refused:
        play_here(stereo_bag, *arguments)
    assert refused.value.code == 2


def test_a_recording_that_breaks_off_is_played_up_to_there(tmp_path):
    """The index is whole, a part of the messages is not."""
    bag = write_bag(tmp_path / 'bag', stereo_messages(120))
    file = bag / 'bag.mcap'
    content = bytearray(file.read_bytes())
    spoilt = slice(len(content) * 2 // 3, len(content) * 2 // 3 + 40_000)
    content[spoilt] = b'\xff' * 40_000
    file.write_bytes(content)
    with listening() as listener:
        listener.listen('/left/camera_info', CameraInfo)
        code, out, error = play_to(listener, bag, '--rate', '5', '--wait-for-subscribers')
        assert code == 1, (out, error)
        [line] = error.splitlines()
        assert 'bag: ' in line
        assert 20 < len(listener.received) < 120
