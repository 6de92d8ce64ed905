"""Images over DDS: raw, compressed, side by side, changed while the node runs; what is said of those not taken."""
import cv2
import numpy as np
import pytest
from node_bench import BASELINE, FOCAL_LENGTH, HEIGHT, WIDTH, camera_info, image_message, random_dots, running_node
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

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


def test_raw_images_without_camera_info_are_told(tmp_path):
    with running_node(tmp_path, '-p', 'num_disparities:=16', '-p', 'input:=raw') as (_, client):
        for side in ('left', 'right'):
            client.advertise(Image, f'{side}/image_raw')

        def publish():
            second = client.next_second()
            for side, pixels in zip(('left', 'right'), random_dots(), strict=True):
                message = image_message(pixels)
                message.header.stamp.sec = second
                client.publish(f'{side}/image_raw', message)

        trouble = client.wait_for_trouble('no left/camera_info has come', each=publish)
        assert 'set input to rectified' in trouble


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
