"""The node from start to end over DDS: settings at the start, silence, QoS, and the signals that end it."""
import re
import signal
import time

import pytest
from node_bench import (
    CHECKOUT,
    Client,
    NodeProcess,
    disparities,
    fresh_domain,
    image_message,
    random_dots,
    running_node,
)
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from stereo_msgs.msg import DisparityImage

SLOW = {'median_scope': 'all', 'w_p': 101}
LARGE = {'width': 320, 'height': 240}
"""As large as Fast DDS carries surely without the profile of config/."""


def dots(**fields):
    return [image_message(pixels) for pixels in random_dots(**fields)]


BAD_SETTINGS = {
    r'w_p = 10 is not allowed: it must be an integer, 1, 3 \.\.\. 101 px': ['-p', 'w_p:=10'],
    r"gradient = 'vertical' is not allowed: it must be horizontal \| magnitude": ['-p', 'gradient:=vertical'],
    r'alpha = .*\[1, 2\].* is not allowed: it must be a number, 0.0 to 1000.0': ['-p', 'alpha:=[1, 2]'],
    r'missing\.yaml': ['--params-file', 'missing.yaml'],
    r"/disparity\.publisher\.reliability = 'sloppy' is not allowed: it must be .*reliable \| best_effort.*; "
    r"qos_overrides\./right/image_raw/compressed\.subscription\.depth = 'few' .*: it must be an integer": [
        '-p', 'qos_overrides./disparity.publisher.reliability:=sloppy',
        '-p', 'qos_overrides./right/image_raw/compressed.subscription.depth:=few'],
    r'started: /x cannot be opened, is another topic remapped to it\?': [
        '-r', 'left/image_rect:=/x', '-r', 'left/camera_info:=/x'],
}


MISSPELT = {
    'alhpa': 'alpha',
    'use_sim_time_': 'use_sim_time',
    'qos_overrides./left/image_rec.subscription.depth': 'qos_overrides./left/image_rect.subscription.depth',
    'qos_overrides./disparity.publisher.depht': 'qos_overrides./disparity.publisher.depth',
}


@pytest.fixture(scope='module')
def refused(tmp_path_factory):
    """One node for each bad setting, all starting at once."""
    folder = tmp_path_factory.mktemp('refused')
    nodes = {
        told: NodeProcess(fresh_domain(), folder / f'{number}.log', *arguments)
        for number, (told, arguments) in enumerate(BAD_SETTINGS.items())
    }
    yield nodes
    for node in nodes.values():
        node.kill()


@pytest.mark.parametrize('told', BAD_SETTINGS)
def test_a_bad_setting_at_the_start_is_told_in_one_line_and_ends_with_2(refused, told):
    node = refused[told]
    assert node.exit_code(limit=60.0) == 2
    lines = [line for line in node.log.splitlines() if 'not started' in line]
    assert len(lines) == 1
    assert re.search(told, lines[0])
    assert 'Traceback' not in node.log


def test_good_settings_at_the_start_are_taken(tmp_path):
    arguments = ['--params-file', str(CHECKOUT / 'config' / 'paper.yaml'), '-p', 'alpha:=2',
                 '-p', 'qos_overrides./left/image_rect.subscription.depth:=3',
                 '-p', 'use_sim_time:=false', '-p', 'start_type_description_service:=true']
    for name in MISSPELT:
        arguments += ['-p', f'{name}:=1']
    with running_node(tmp_path, *arguments) as (node, client):
        for name, meant in MISSPELT.items():
            assert f'unknown parameter {name!r} is ignored: did you mean {meant}?' in node.log
        assert node.log.count('unknown parameter') == len(MISSPELT)
        assert client.get_parameters('alpha', 'gradient', 'sigma_tree') == {
            'alpha': 2.0, 'gradient': 'magnitude', 'sigma_tree': 0.1}
        assert client.get_parameters('qos_overrides./left/image_rect.subscription.depth') == {
            'qos_overrides./left/image_rect.subscription.depth': 3}
        refused = client.set_parameters(**{'qos_overrides./left/image_rect.subscription.depth': 4})
        assert all('start the node anew' in result.reason for result in refused.values())
        assert client.set_parameters(alpha=3.5)['alpha'].successful


def test_what_is_missing_is_told_one_after_the_other(tmp_path):
    with running_node(tmp_path) as (node, client):
        node.wait_for_log('no images for 5 s')
        left, right = dots()
        seconds = iter(range(100, 1000))

        def send_left():
            left.header.stamp.sec = next(seconds)
            client.publish('left/image_rect', left)

        told = 'images on /left/image_rect but none for 5 s on /right/image_rect (1 publisher)'
        client.spin_until(lambda: told in node.log, told, each=send_left)
        told = 'are at least 0.004000 s apart, approximate_sync_tolerance is 0 s'
        client.spin_until(
            lambda: told in node.log, told, each=lambda: client.publish_pair(left, right, right_delay_ns=4_000_000))
        assert 'set approximate_sync_tolerance to 0.006' in node.wait_for_log(told)
        assert client.set_parameters(approximate_sync_tolerance=0.006)['approximate_sync_tolerance'].successful
        message = client.exchange_until(*dots(), lambda message: True, 'a disparity')
        assert (message.f, message.t) == (0, 0)
        line = node.wait_for_log('no left/camera_info and no right/camera_info received')
        assert 'disparity published with f = 0, t = 0' in line
        assert client.set_parameters(baseline=0.5)['baseline'].successful
        client.wait_for_trouble('the parameter baseline = 0.5 m is not enough',
                                each=lambda: client.publish_pair(*dots()))


def test_images_that_come_during_the_compilation_are_dropped_and_counted(tmp_path):
    cache = tmp_path / 'cache'
    domain = fresh_domain()
    node, client = NodeProcess(domain, tmp_path / 'node.log', NUMBA_CACHE_DIR=str(cache)), Client(domain)
    try:
        node.wait_for_log('compiling the kernels')
        client.spin_until(
            lambda: any('dropped: before warm-up' in counts for counts in client.diagnostics), 'counts of drops',
            each=lambda: client.publish_pair(*dots(width=8, height=6)))
        assert 'ready:' not in node.log
        assert client.received == []
        assert node.end(signal.SIGINT, limit=5.0) == 0
        assert 'Traceback' not in node.log
    finally:
        client.close()
        node.kill()


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_a_node_at_work_with_0(tmp_path, number):
    with running_node(tmp_path) as (node, client):
        client.wait_for_node()
        assert client.set_atomically(**SLOW).successful
        for _ in range(3):
            client.publish_pair(*dots(**LARGE))
        assert node.end(number, limit=5.0) == 0
        assert 'Traceback' not in node.log


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
@pytest.mark.parametrize(('delay', 'times'), [(0.0, 1), (0.2, 2), (0.5, 1), (1.0, 2)])
def test_a_signal_while_the_node_starts_ends_it_with_0(tmp_path, number, delay, times):
    node = NodeProcess(fresh_domain(), tmp_path / 'node.log')
    try:
        node.wait_until_it_handles_signals()
        time.sleep(delay)
        for _ in range(times):
            node.send(number)
        assert node.exit_code(limit=5.0) == 0
        assert node.log == '' or delay >= 0.5  # told nothing before it had begun
        assert 'Traceback' not in node.log
    finally:
        node.kill()


def test_a_node_that_is_ended_takes_leave_of_the_others(tmp_path):
    with running_node(tmp_path) as (node, client):
        client.wait_for_node()
        client.publish_infos()
        client.exchange_until(*dots(), lambda message: message.f > 0 and message.t > 0, 'camera_info taken')
        assert 'camera_info received' not in node.log  # the first pair came before it
        assert client.publishers_of('disparity') == 1
        assert node.end(signal.SIGINT, limit=5.0) == 0
        client.spin_until(lambda: client.publishers_of('disparity') == 0, 'no publisher left', limit=3.0)


def test_an_impatient_user_gets_0_as_well(tmp_path):
    with running_node(tmp_path) as (node, _):
        while node.running:
            node.send(signal.SIGINT)
            time.sleep(0.002)
        assert node.exit_code() == 0
        assert 'Traceback' not in node.log


DEFECTS = """
import sys
from stereo_msgs.msg import DisparityImage
from svdm_ros.frames import frame_processing
from svdm_ros.node import disparity_node
from rclpy.executors import SingleThreadedExecutor
from svdm_ros.__main__ import main

# As if it stood in the node's module: an error of rclpy's own would be a bad request.
exec("def fail(*_): raise ValueError('made to fail')", vars(disparity_node))
frame_processing.FrameProcessor.warm_up = disparity_node.fail
disparity_node.CameraInfos.take = disparity_node.fail

# What rclpy raises where a message does not fit into the memory; when it does is up to the moment.
spin_once, errors = SingleThreadedExecutor.spin_once, [MemoryError(), RuntimeError('Unable to convert')]
SingleThreadedExecutor.spin_once = lambda self: fail_to_take(errors.pop()) if errors else spin_once(self)
def fail_to_take(error): raise error
sys.exit(main())
"""


def test_defects_of_the_node_are_told_and_counted_and_do_not_end_it(tmp_path):
    domain = fresh_domain()
    node = NodeProcess(domain, tmp_path / 'node.log', '-p', 'num_disparities:=16', program=('-c', DEFECTS))
    client = Client(domain)
    try:
        node.wait_for_log('warm-up cut short, the first pairs take longer by a defect of this node')
        client.exchange_until(*dots(), lambda message: True, 'a disparity')
        client.publish_infos()
        node.wait_for_log('callback cut short by a defect of this node, please report it: Traceback')
        client.exchange(*dots())
        counts = client.counts()
        assert counts['defects'] == 3
        assert 'dropped: failed' not in counts
        assert counts['dropped: not taken'] == counts['dropped: no memory'] == 1
        assert 'message dropped, rclpy cannot take it: Unable to convert: look at its size' in node.log
        assert 'message dropped: the memory is used up' in node.log
        assert 'a request was dropped' not in node.log
        assert node.log.count('made to fail') == 2  # the second callback of a kind is held back
        assert node.end(signal.SIGINT, limit=5.0) == 0
    finally:
        client.close()
        node.kill()


def test_an_incompatible_qos_is_told_with_the_setting_that_mends_it(tmp_path):
    override = 'qos_overrides./left/image_rect.subscription.reliability'
    best_effort = QoSProfile(depth=10, reliability=ReliabilityPolicy.BEST_EFFORT)
    latched = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    told = {
        '/left/image_rect: a publisher has an incompatible QoS (RELIABILITY)': f'-p {override}:=',
        '/disparity: a subscription has an incompatible QoS (DURABILITY)':
            '-p qos_overrides./disparity.publisher.durability:=',
    }
    arguments = ['-p', f'{override}:=reliable']
    with running_node(tmp_path, *arguments, image_qos=best_effort, disparity_qos=latched) as (node, client):
        client.subscribe(DisparityImage, 'disparity', [])  # else the node takes no images
        for problem, remedy in told.items():
            line = node.wait_for_log(problem)
            assert '[ERROR]' in line
            assert remedy in line
        others = [Client(node.domain, latched, best_effort) for _ in range(2)]
        time.sleep(2.0)
        for other in others:
            other.close()
        for problem in told:
            assert node.log.count(problem) == 1
        assert node.end(signal.SIGINT, limit=5.0) == 0


def test_the_newest_pair_wins_when_the_node_is_too_slow(tmp_path):
    with running_node(tmp_path) as (_, client):
        client.wait_for_node()
        assert client.set_atomically(**SLOW).successful
        pair = dots(**LARGE)

        def newest_is_answered():
            for _ in range(12):
                last = client.publish_pair(*pair)
            end = time.monotonic() + 10.0
            while time.monotonic() < end and client.received[-1].header.stamp.sec < last:
                client.spin_for(0.1)
            return client.received[-1].header.stamp.sec == last

        # The camera is best effort: where the last image was lost, the node could not answer it.
        client.exchange_until(*pair, lambda message: True, 'a first disparity')
        assert any(newest_is_answered() for _ in range(4))
        client.spin_until(
            lambda: any(int(counts.get('dropped: superseded', 0)) > 0 for counts in client.diagnostics), 'the drops')
        stamps = [message.header.stamp.sec for message in client.received]
        assert stamps == sorted(stamps)
        assert disparities(client.received[-1]).shape == (240, 320)
