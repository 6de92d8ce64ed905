"""Images over DDS: raw, compressed, side by side, changed while the node runs; what is said of those not taken."""
import cv2
import numpy as np
import pytest
from node_bench import (
    BASELINE,
    FOCAL_LENGTH,
    HEIGHT,
    PRINCIPAL_OFFSET,
    WIDTH,
    Client,
    NodeProcess,
    camera_info,
    disparities,
    fresh_domain,
    image_message,
    random_dots,
    running_node,
)
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from stereo_msgs.msg import DisparityImage

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
DEFAULTS = {'input': 'rectified', 'transport': 'raw', 'layout': 'separate'}


@pytest.fixture(scope='module')
def running(tmp_path_factory):
    with running_node(tmp_path_factory.mktemp('node'), '-p', 'num_disparities:=16') as (node, client):
        client.wait_for_node()
        yield node, client
        assert node.end() == 0


@pytest.fixture
def client(running):
    client = running[1]
    yield client
    assert client.set_atomically(**DEFAULTS).successful


def raw_info(side):
    """That of a camera without distortion, which rectification leaves alone."""
    info = camera_info(side)
    info.k = [FOCAL_LENGTH, 0.0, info.p[2], 0.0, FOCAL_LENGTH, HEIGHT / 2, 0.0, 0.0, 1.0]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    info.distortion_model, info.d = 'plumb_bob', [0.0] * 5
    return info


def packed(pixels):
    return CompressedImage(format='mono8; png compressed', data=cv2.imencode('.png', pixels)[1].tobytes())


def answer_to(client, messages):
    """The disparity of images that are published again and again, topic -> message."""
    seconds = set()

    def publish():
        second = client.next_second()
        seconds.add(second)
        for side in ('left', 'right'):
            client.publish(f'{side}/camera_info', raw_info(side))
        for topic, message in messages.items():
            message.header.stamp.sec = second
            client.publish(topic, message)

    return client.spin_until(
        lambda: next((message for message in client.received if message.header.stamp.sec in seconds and message.f > 0),
                     None), 'a disparity', each=publish)


@pytest.mark.parametrize('values', [
    {}, {'input': 'raw'}, {'transport': 'compressed'}, {'input': 'raw', 'transport': 'compressed'},
    {'layout': 'side_by_side'}, {'input': 'raw', 'layout': 'side_by_side', 'transport': 'compressed'}])
def test_images_in_any_form_give_the_same_bytes(client, values):
    left, right = random_dots()
    plain = answer_to(client, {'left/image_rect': image_message(left), 'right/image_rect': image_message(right)})
    assert client.set_atomically(**{**DEFAULTS, **values}).successful
    name = 'image_raw' if values.get('input') == 'raw' else 'image_rect'
    end, message = ('/compressed', packed) if 'transport' in values else ('', image_message)
    images = {f'left/{name}{end}': message(left), f'right/{name}{end}': message(right)}
    if 'layout' in values:
        images = {f'{name}{end}': message(np.hstack([left, right]))}
    for topic, image in images.items():
        client.advertise(type(image), topic)
    found = answer_to(client, images)
    assert found.image.data == plain.image.data
    assert (found.f, found.t) == (FOCAL_LENGTH, pytest.approx(BASELINE))


CAMERAS = {'front': (['-p', 'input:=raw'], 'image_raw', image_message, 7),
           'rear': (['-p', 'transport:=compressed'], 'image_rect/compressed', packed, 4)}
"""Namespace -> arguments of its node, topic below left and right, what makes a message, disparity."""


@pytest.fixture(scope='module')
def two_nodes(tmp_path_factory):
    """One node a camera, each in its namespace."""
    folder, domain = tmp_path_factory.mktemp('two'), fresh_domain()
    nodes = [NodeProcess(domain, folder / f'{name}.log', '-r', f'__ns:=/{name}', '-p', 'num_disparities:=16',
                         '-p', 'num_threads:=1', *arguments) for name, (arguments, *_) in CAMERAS.items()]
    client = Client(domain)
    try:
        yield nodes, client
    finally:
        client.close()
        for node in nodes:
            node.kill()


def send(client, infos):
    """A pair of each camera, and camera_info if wanted."""
    second = client.next_second()
    for name, (_, topic, message, shift) in CAMERAS.items():
        for side, pixels in zip(('left', 'right'), random_dots(shift=shift), strict=True):
            image = message(pixels)
            image.header.stamp.sec, image.header.frame_id = second, name
            messages = {f'/{name}/{side}/{topic}': image}
            if infos:
                messages = {f'/{name}/{side}/camera_info': raw_info(side), **messages}
            for where, what in messages.items():
                client.advertise(type(what), where)
                client.publish(where, what)


def test_raw_images_without_camera_info_are_told(two_nodes):
    _, client = two_nodes
    client.subscribe(DisparityImage, '/front/disparity', [])
    client.spin_until(lambda: any('no left/camera_info has come' in trouble and 'set input to rectified' in trouble
                                  for trouble in client.troubles), 'the line', 60.0, lambda: send(client, infos=False))


def test_two_nodes_in_two_namespaces_one_raw_and_one_compressed_run_side_by_side(two_nodes):
    nodes, client = two_nodes
    received = {name: [] for name in CAMERAS}
    for name, messages in received.items():
        client.subscribe(DisparityImage, f'/{name}/disparity', messages)
    client.spin_until(lambda: all(messages and messages[-1].f > 0 for messages in received.values()),
                      'both disparities', 60.0, lambda: send(client, infos=True))
    for name, (*_, shift) in CAMERAS.items():
        message = received[name][-1]
        assert message.header.frame_id == name
        assert np.median(disparities(message)[:, shift + 5:]) == pytest.approx(shift - PRINCIPAL_OFFSET, abs=0.1)
    assert not client.received  # nothing outside the namespaces
    assert [node.end() for node in nodes] == [0, 0]
    assert not any('[ERROR]' in node.log or 'Traceback' in node.log for node in nodes)


def test_camera_info_that_was_latched_before_the_node_came_reaches_it(tmp_path):
    with running_node(tmp_path, '-p', 'num_disparities:=16', '-r', 'left/camera_info:=left/latched', '-r',
                      'right/camera_info:=right/latched') as (_, client):
        for side in ('left', 'right'):
            client.advertise(CameraInfo, f'{side}/latched', LATCHED)
            client.publish(f'{side}/latched', camera_info(side))
        client.exchange_until(*map(image_message, random_dots()), lambda message: message.t > 0, 'the baseline')


def test_images_on_other_topics_are_told_with_the_parameters_that_take_them(tmp_path):
    with running_node(tmp_path, '-p', 'num_disparities:=16', '-r', 'left/image_rect:=a', '-r',
                      'right/image_rect:=b') as (_, client):
        for side in ('left', 'right'):
            client.advertise(Image, f'{side}/image_raw')
        client.wait_for_trouble('left/image_raw and right/image_raw: -p input:=raw takes them')


def test_images_taken_for_rectified_that_are_not_are_told(tmp_path):
    info = raw_info('left')
    info.d = [-0.2, 0.0, 0.0, 0.0, 0.0]
    with running_node(tmp_path, '-p', 'num_disparities:=16', '-r', 'left/image_rect:=left/image', '-r',
                      'right/image_rect:=right/image') as (_, client):
        for side in ('left', 'right'):
            client.advertise(Image, f'{side}/image')

        def publish():
            client.publish('left/camera_info', info)
            client.publish('right/camera_info', raw_info('right'))

        assert 'input' in client.wait_for_trouble('left/image', each=publish)


def test_other_sizes_in_a_row_go_through(client):
    for width, height in ((WIDTH, HEIGHT), (64, 48), (WIDTH, HEIGHT)):
        images = random_dots(width=width, height=height)
        message = client.exchange(*map(image_message, images))
        assert (message.image.width, message.image.height) == (width, height)


def test_a_topic_that_cannot_be_opened_later_is_told_and_the_node_goes_on(tmp_path):
    other = '-r', 'right/image_raw:=right/camera_info'
    with running_node(tmp_path, '-p', 'num_disparities:=16', *other) as (node, client):
        client.wait_for_node()
        assert client.set_atomically(input='raw').successful
        client.wait_for_trouble('right/camera_info cannot be opened, is another topic remapped to it?')
        client.counts()
        client.counts()
        # An attempt each second opens the left topic for a moment.
        client.spin_until(lambda: client.subscribers_of('/left/image_raw') == 0, 'nothing is left of the attempts')
        assert client.set_atomically(input='rectified').successful
        client.wait_for_node()
        assert 'Traceback' not in node.log
