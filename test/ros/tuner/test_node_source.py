"""A live node, watched and moved over DDS."""
import threading

import numpy as np
import pytest
from node_bench import NodeProcess, fresh_domain, image_message, random_dots, running_node
from sensor_msgs.msg import Image
from stereo_msgs.msg import DisparityImage
from tuner_process import wait_until

from svdm_ros.tuner.node_source import NodeSource

LEFT, RIGHT = random_dots()


@pytest.fixture
def watched(tmp_path, monkeypatch):
    with running_node(tmp_path, '-p', 'num_disparities:=16') as (node, client):
        monkeypatch.setenv('ROS_DOMAIN_ID', str(node.domain))
        source = NodeSource('/disparity_node', [])
        source.start()
        try:
            yield node, client, source
        finally:
            source.stop()


def until(client, condition, what):
    """Pairs are sent all the while."""
    pair = image_message(LEFT), image_message(RIGHT)
    return client.spin_until(condition, what, each=lambda: client.publish_pair(*pair))


def test_a_live_node_is_seen_and_moved(watched):
    _, client, source = watched
    client.publish_infos()
    shot = until(client, lambda: (shot := source.latest()) and shot.left.any() and shot, 'a shot with its left image')
    assert shot.disparity.shape == LEFT.shape and shot.confidence.shape == LEFT.shape and shot.trusted.any()
    assert (shot.left == LEFT).all() and shot.limits[1] - shot.limits[0] == 15
    assert source.values()['num_disparities'] == 16
    assert source.change({'p2': 0.6, 'final_median': 5}) == ''
    assert client.get_parameters('p2', 'final_median') == {'p2': 0.6, 'final_median': 5}
    reason = source.change({'p2': -3.0})
    assert 'p2' in reason and '-3' in reason and client.get_parameters('p2')['p2'] == 0.6
    assert source.values()['p2'] == 0.6
    assert client.set_atomically(p2=1.2).successful
    until(client, lambda: source.values()['p2'] == 1.2, 'what somebody else has set')
    figures = until(client, lambda: 'rate' in source.figures() and source.figures(), 'diagnostics')
    assert {'time of a frame', 'valid pixels', 'confident pixels', 'streaks'} <= set(figures)


def test_messages_that_are_none_harm_nothing(watched):
    _, client, source = watched
    client.advertise(Image, 'confidence')
    client.advertise(DisparityImage, 'disparity')
    until(client, lambda: client.subscribers_of('confidence') and source.latest(), 'a shot')
    odd = image_message(np.zeros((3, 2), np.uint8))

    def send_odd():
        client.publish('confidence', odd)
        client.publish('disparity', DisparityImage(image=odd))

    client.spin_until(lambda: 'could not be shown' in source.trouble(), 'the trouble', each=send_odd)
    number = source.latest().number
    until(client, lambda: source.latest().number > number + 2, 'further shots')
    assert source.change({'p2': 0.5}) == ''


def test_a_pair_is_held(watched):
    _, client, source = watched
    client.publish_infos()
    until(client, source.values, 'parameters')
    found = []
    thread = threading.Thread(target=lambda: found.append(source.hold()))
    thread.start()
    until(client, lambda: not thread.is_alive(), 'a pair')
    assert bytes(found[0].left.data) == LEFT.tobytes() and bytes(found[0].right.data) == RIGHT.tobytes()


def test_a_node_that_is_not_there_is_waited_for_and_one_that_goes_is_told(tmp_path, monkeypatch):
    domain = fresh_domain()
    monkeypatch.setenv('ROS_DOMAIN_ID', str(domain))
    source = NodeSource('/disparity_node', [])
    source.start()
    node = None
    try:
        wait_until(lambda: 'is not there: start it' in source.trouble(), 'the trouble')
        assert source.change({'p2': 0.5}) == '/disparity_node is not there' and source.values() == {}
        assert source.hold() is None
        node = NodeProcess(domain, tmp_path / 'node.log')
        wait_until(source.values, 'its parameters', 60.0)
        node.kill()
        wait_until(lambda: 'is not there: start it' in source.trouble(), 'the trouble', 60.0)
        assert source.values() == {}
    finally:
        if node is not None:
            node.kill()
        source.stop()


def test_arguments_that_are_none_of_ros_are_refused():
    with pytest.raises(ValueError, match='--ros-args are not understood'):
        NodeSource('/disparity_node', ['--ros-args', '-r', 'nonsense']).start()
