"""The outputs over DDS: all of one pair, and none that nobody listens to."""
import importlib
import re
import time
from pathlib import Path

import numpy as np
import psutil
import pytest
from node_bench import image_message, random_dots, running_node

from svdm_ros.frames import outputs
from svdm_ros.node.parameter_set import NodeParameters
from svdm_ros.processes.dds_profile import SMALLEST_SEGMENT_BYTES

OUTPUTS = [output for output in outputs.OUTPUTS if output.when(NodeParameters())]
IMAGES = ('/left/image_rect', '/right/image_rect')


@pytest.fixture(scope='module')
def running(tmp_path_factory):
    with running_node(tmp_path_factory.mktemp('node')) as (node, client):
        client.wait_for_node()
        client.publish_infos()
        yield node, client
        assert node.end() == 0


def dots():
    return [image_message(pixels) for pixels in random_dots()]


def kind_of(output):
    package, _, name = output.message_type.split('/')
    return getattr(importlib.import_module(f'{package}.msg'), name)


def of_pair(messages, second):
    return [message for message in messages if message.header.stamp.sec == second]


def test_all_outputs_of_a_pair_have_its_header_and_agree(running):
    _, client = running
    received = {output.topic: [] for output in OUTPUTS}
    for output in OUTPUTS[1:]:
        client.subscribe(kind_of(output), output.topic, received[output.topic])
    received['disparity'] = client.received
    try:
        client.exchange_until(*dots(), lambda message: all(received.values()) and message.f > 0, 'all outputs')
        second = client.publish_pair(*dots())
        client.spin_until(lambda: all(of_pair(messages, second) for messages in received.values()), 'all outputs of it')
        of = {topic: of_pair(messages, second)[0] for topic, messages in received.items()}
        assert {message.header.frame_id for message in of.values()} == {'left_camera'}
        disparity = np.frombuffer(of['disparity'].image.data, np.float32)
        depth = np.frombuffer(of['depth/image_rect'].data, np.float32)
        confidence = np.frombuffer(of['confidence'].data, np.float32)
        assert len(set(confidence)) > 100 and confidence.min() >= 0 and confidence.max() <= 1
        confident = confidence >= np.float32(NodeParameters().confidence_threshold)
        assert (disparity >= of['disparity'].min_disparity).all() and not confident.all()
        ahead = confident & (disparity > 0)
        np.testing.assert_allclose(depth[ahead], of['disparity'].f * of['disparity'].t / disparity[ahead], rtol=1e-6)
        assert np.isnan(depth[~ahead]).all() and ahead.mean() > 0.9
        cloud = np.frombuffer(of['points2'].data, np.float32).reshape(-1, 4)
        np.testing.assert_array_equal(cloud[:, 2], depth)
        preview = np.frombuffer(of['disparity/preview'].data, np.uint8).reshape(-1, 3)
        np.testing.assert_array_equal(preview.any(axis=1), confident)
    finally:
        for output in OUTPUTS[1:]:
            client.unsubscribe(output.topic)


def test_images_are_taken_only_while_somebody_listens(running):
    node, client = running
    client.exchange(*dots())
    assert all(client.subscribers_of(topic) == 1 for topic in IMAGES)
    client.unsubscribe('disparity')
    client.spin_until(lambda: not any(map(client.subscribers_of, IMAGES)), 'the node to take no images any more')
    before = client.counts()
    for _ in range(5):
        client.publish_pair(*dots())
        time.sleep(0.05)
    after = client.counts()
    assert after['left images'] == before['left images'] and after['published'] == before['published']
    assert 'no images' not in node.log
    depths = []
    client.subscribe(kind_of(OUTPUTS[1]), OUTPUTS[1].topic, depths)
    client.spin_until(lambda: depths, 'the first depth', each=lambda: client.publish_pair(*dots()))
    client.unsubscribe(OUTPUTS[1].topic)
    client.subscribe(kind_of(OUTPUTS[0]), OUTPUTS[0].topic, client.received)
    client.exchange_until(*dots(), lambda message: True, 'a disparity again')
    assert 'no images' not in node.log


def test_an_idle_node_hardly_works(running):
    node, client = running
    client.unsubscribe('disparity')
    client.spin_until(lambda: not any(map(client.subscribers_of, IMAGES)), 'the node to take no images any more')
    process = psutil.Process(node.pid)
    before, start = process.cpu_times(), time.monotonic()
    for _ in range(60):
        client.publish_pair(*dots())
        time.sleep(1 / 30)
    after = process.cpu_times()
    used = after.user + after.system - before.user - before.system
    assert used < 0.06 * (time.monotonic() - start)
    client.subscribe(kind_of(OUTPUTS[0]), OUTPUTS[0].topic, client.received)
    client.exchange_until(*dots(), lambda message: True, 'a disparity again')


def test_the_node_has_shared_memory_for_images_where_no_profile_is_set(running):
    maps = Path(f'/proc/{running[0].pid}/maps').read_text()
    segments = {path for path in re.findall(r'/dev/shm/fastrtps_\w+', maps) if Path(path).exists()}
    assert max(Path(path).stat().st_size for path in segments) >= SMALLEST_SEGMENT_BYTES  # 0.5 MB by default


def test_at_most_so_many_pairs_a_second_are_matched_and_the_newest(running):
    _, client = running
    assert client.set_atomically(max_rate=5.0).successful
    client.exchange(*dots())
    del client.received[:]
    for _ in range(40):
        last = client.publish_pair(*dots())
        client.spin_for(0.05)
    client.spin_until(lambda: client.received[-1].header.stamp.sec == last, 'the last pair')
    assert 6 <= len(client.received) <= 14  # 2 s
    assert client.counts()['dropped: above max_rate'] > 20
    assert client.set_atomically(max_rate=0.0).successful


@pytest.mark.parametrize(('values', 'told'), [
    ({'roi': '1, 2'}, "roi = '1, 2' is not allowed: it must be four integers"),
    ({'min_depth': 3.0, 'max_depth': 2.0}, 'max_depth = 2 is not allowed'),
    ({'downscale': 5}, 'downscale = 5 is not allowed: it must be an integer, 1 to 4'),
    ({'depth_encoding': '8UC1'}, "depth_encoding = '8UC1' is not allowed: it must be 32FC1 | 16UC1")])
def test_settings_that_make_no_sense_are_refused(running, values, told):
    result = running[1].set_atomically(**values)
    assert not result.successful and told in result.reason


def test_the_size_of_outputs_follows_roi_and_downscale_while_running(running):
    _, client = running
    assert client.set_atomically(roi='8, 4, 100, 80', downscale=2).successful
    message = client.exchange(*dots())
    assert (message.image.width, message.image.height, message.f) == (50, 40, 50.0)
    assert client.set_atomically(roi='', downscale=1).successful
