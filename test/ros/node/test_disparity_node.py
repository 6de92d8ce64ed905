"""The node over DDS, as its own process: messages, parameters, encodings, loops and bad input."""
import signal
import time

import numpy as np
import pytest
from encoded_images import as_stored
from node_bench import (
    BASELINE,
    FOCAL_LENGTH,
    HEIGHT,
    PRINCIPAL_OFFSET,
    SHIFT,
    WIDTH,
    camera_info,
    disparities,
    image_message,
    random_dots,
    running_node,
)

from svdm_ros.frames.image_conversion import ENCODINGS
from svdm_ros.node.declared_parameters import descriptor
from svdm_ros.node.parameter_set import node_parameter_table

DEFAULTS = {info.name: info.default for info in node_parameter_table()}


@pytest.fixture(scope='module')
def running(tmp_path_factory):
    with running_node(tmp_path_factory.mktemp('node')) as (node, client):
        client.wait_for_node()
        yield node, client
        assert node.end() == 0


@pytest.fixture
def node(running):
    return running[0]


@pytest.fixture
def client(running):
    client = running[1]
    assert client.set_atomically(**DEFAULTS).successful
    client.publish_infos()
    client.exchange_until(*dots(), lambda message: message.f > 0 and message.t > 0, 'camera_info taken')
    return client


def dots(**fields):
    return [image_message(pixels) for pixels in random_dots(**fields)]


def test_every_field_of_the_disparity_image(client):
    assert client.set_atomically(min_disparity=2, num_disparities=16, subpixel=False, plane_fit=False).successful
    message = client.exchange(*dots())
    stamp = message.header.stamp
    assert (message.header.frame_id, stamp.nanosec) == ('left_camera', 5000)
    assert message.image.header == message.header
    image = message.image
    assert (image.width, image.height, image.step, image.encoding) == (WIDTH, HEIGHT, 4 * WIDTH, '32FC1')
    assert (image.is_bigendian, len(image.data)) == (0, 4 * WIDTH * HEIGHT)
    assert message.f == FOCAL_LENGTH
    assert message.t == pytest.approx(BASELINE)
    assert (message.min_disparity, message.max_disparity) == (1.5 - PRINCIPAL_OFFSET, 17.5 - PRINCIPAL_OFFSET)
    assert message.delta_d == 1.0
    window = message.valid_window
    assert (window.x_offset, window.y_offset, window.width, window.height) == (0, 0, WIDTH, HEIGHT)
    right_of_border = disparities(message)[:, SHIFT:]
    assert np.mean(right_of_border == SHIFT - PRINCIPAL_OFFSET) > 0.98


def test_a_search_that_begins_nearer_than_infinity_is_told_once_and_not_as_a_warning(node, client):
    text = 'infinity lies at 2.5 px'
    for start in (4, 4, 5):
        assert client.set_atomically(min_disparity=start).successful
        for _ in range(2):
            client.exchange(*dots())
    client.spin_until(lambda: 'begins at 5 px' in node.log, 'the hint')
    lines = [line for line in node.log.splitlines() if text in line]
    assert sum('begins at 4 px' in line for line in lines) == sum('begins at 5 px' in line for line in lines) == 1
    assert all('[INFO]' in line and 'set min_disparity to 2' in line for line in lines)


def test_only_measured_pixels_on_demand(client):
    assert client.set_atomically(publish_filled=False, min_disparity=3, subpixel=False).successful
    message = client.exchange(*dots())
    disparity = disparities(message)
    valid = disparity >= message.min_disparity
    assert np.mean(valid[:, SHIFT:]) > 0.9
    assert not valid[:, :3].any()
    np.testing.assert_array_equal(disparity[~valid], message.min_disparity - 1)
    assert (message.valid_window.x_offset, message.valid_window.width) == (3, WIDTH - 3)


def test_a_parameter_change_takes_effect_on_the_next_frame(client):
    for count, subpixel in ((32, False), (8, True)):
        results = client.set_parameters(num_disparities=count, subpixel=subpixel, plane_fit=False)
        assert all(result.successful for result in results.values())
        message = client.exchange(*dots())
        assert message.max_disparity - message.min_disparity == count
        assert (message.delta_d == 1.0) is not subpixel


@pytest.mark.parametrize(('name', 'value', 'told'), [
    ('alpha', -1.0, 'alpha'),
    ('alpha', float('nan'), 'alpha'),
    ('w_p', 10, 'w_p'),
    ('num_disparities', 0, 'num_disparities'),
    ('gradient', 'vertical', "gradient = 'vertical' is not allowed: it must be horizontal | magnitude"),
    ('subpixel', 1, 'subpixel = 1 is not allowed: it must be true | false'),
    ('publish_filled', 'no', "publish_filled = 'no' is not allowed: it must be true | false"),
    ('alpha', 'much', "alpha = 'much' is not allowed: it must be a number, 0.0 to 1000.0"),
    ('w_p', [5, 7], 'w_p = '),
    ('subpixel', None, 'subpixel = None is not allowed: it must be true | false'),
    ('queue_size', 0, 'queue_size'),
    ('alhpa', 1.0, "'alhpa': did you mean alpha?"),
])
def test_a_bad_value_is_refused_with_a_reason_and_the_old_one_kept(client, name, value, told):
    before = client.get_parameters(*DEFAULTS)
    result = client.set_parameters(**{name: value})[name]
    assert not result.successful
    assert told in result.reason
    assert client.get_parameters(*DEFAULTS) == before
    assert client.exchange(*dots()).max_disparity == 63.5 - PRINCIPAL_OFFSET


def test_a_set_is_taken_as_a_whole_or_not_at_all(client):
    refused = client.set_atomically(num_disparities=24, gradient='vertical')
    assert not refused.successful
    assert client.exchange(*dots()).max_disparity == 63.5 - PRINCIPAL_OFFSET
    assert client.get_parameters('num_disparities') == {'num_disparities': 64}
    assert client.set_atomically(num_disparities=24, gradient='magnitude').successful
    assert client.exchange(*dots()).max_disparity == 23.5 - PRINCIPAL_OFFSET


def test_a_whole_number_is_taken_for_a_double(client):
    assert client.set_parameters(alpha=3)['alpha'].successful
    value = client.get_parameters('alpha')['alpha']
    assert (value, type(value)) == (3.0, float)


def test_every_parameter_is_described_as_in_the_table(client):
    described = client.describe_parameters(*DEFAULTS)
    assert described == [descriptor(info) for info in node_parameter_table()]


def test_a_malformed_request_does_not_end_the_node(node, client):
    client.send_malformed_request()
    node.wait_for_log('a request was dropped')
    assert client.get_parameters('alpha') == {'alpha': DEFAULTS['alpha']}
    client.exchange(*dots())


@pytest.mark.parametrize('encoding', ENCODINGS)
def test_each_encoding_gives_the_disparity(client, encoding):
    shift = SHIFT + 1  # even, as a mosaic shifts by whole cells
    message = client.exchange(*(
        image_message(as_stored(pixels, encoding), encoding, height=HEIGHT) for pixels in random_dots(shift=shift)))
    interior = disparities(message)[3:-3, shift + 3:-3]
    assert np.mean(np.abs(interior - (shift - PRINCIPAL_OFFSET)) < 0.5) > 0.95


def test_sixteen_bits_big_endian_and_padded_rows(client):
    messages = []
    for pixels in random_dots():
        padded = np.pad(pixels.astype('>u2') * 257, ((0, 0), (0, 3)))
        messages.append(image_message(padded, 'mono16', width=WIDTH, is_bigendian=1))
    message = client.exchange(*messages)
    assert message.image.width == WIDTH
    assert np.mean(np.abs(disparities(message)[:, SHIFT:] - (SHIFT - PRINCIPAL_OFFSET)) < 0.5) > 0.95


@pytest.mark.parametrize(('width', 'height'), [(60, 45), (240, 180), (1, 1), (5, 1)])
def test_the_size_may_change_and_f_with_it(client, width, height):
    client.publish_infos(width=width, height=height)
    client.exchange_until(
        *dots(width=width, height=height),
        lambda message: message.f == FOCAL_LENGTH and message.image.width == width, 'camera_info of the new size')
    client.publish_infos(width=2 * width, height=2 * height)
    client.exchange_until(*dots(width=width, height=height), lambda m: m.f == FOCAL_LENGTH / 2, 'f at half the size')


def test_a_looping_bag_gives_all_its_pairs_on_every_pass(client):
    seconds = range(100, 106)
    answered = [client.exchange(*dots(), second=second).header.stamp.sec for _ in range(3) for second in seconds]
    assert answered == [*seconds] * 3


def test_stamps_within_the_tolerance_are_paired(client):
    assert client.set_atomically(approximate_sync_tolerance=0.002).successful
    client.exchange(*dots(), right_delay_ns=1_500_000)


BAD_PAIRS = {
    'left image dropped: encoding': lambda left, right: setattr(left, 'encoding', 'nv24'),
    'right image dropped: the data has': lambda left, right: right.data.pop(),
    'left image dropped: step is 100': lambda left, right: setattr(left, 'step', 100),
    'left image dropped: the image is empty: 0x0': lambda left, right: (
        setattr(left, 'height', 0), setattr(left, 'width', 0)),
    'the left image has 120x90 px, the right 120x45': lambda left, right: (
        setattr(right, 'height', 45), setattr(right, 'data', right.data[:45 * WIDTH])),
    'the left image is mono8, the right mono16': lambda left, right: (
        setattr(right, 'encoding', 'mono16'), setattr(right, 'step', 240), right.data.extend(right.data)),
}


@pytest.mark.parametrize('told', BAD_PAIRS)
def test_a_bad_pair_is_told_and_the_next_one_answered(client, told):
    left, right = dots()
    BAD_PAIRS[told](left, right)
    client.wait_for_trouble(told, each=lambda: client.publish_pair(left, right))
    client.exchange(*dots())


def test_pairs_that_do_not_match_are_told_once_and_when_they_do_again(node, client):
    left, right = dots()
    for _ in range(2):
        client.wait_for_trouble('of the pixels are valid', each=lambda: client.exchange(right, left))
    assert float(client.diagnostics[-1]['valid pixels (%)']) < 40
    assert float(client.diagnostics[-1]['confidence above confidence_threshold (%)']) < 10
    client.spin_until(lambda: 'most pixels are valid again' in node.log, 'the end of it',
                      each=lambda: client.exchange(left, right))
    assert node.log.count('of the pixels are valid') == 1


def test_a_camera_info_of_the_images_own_stamp_is_taken_before_a_later_one(client):
    second = client.next_second()
    for side in ('left', 'right'):
        info = camera_info(side)
        info.header.stamp.sec, info.header.stamp.nanosec = second, 5000
        client.publish(f'{side}/camera_info', info)
    client.publish_infos(width=WIDTH // 2, height=HEIGHT // 2)
    client.exchange_until(*dots(), lambda message: message.f == 2 * FOCAL_LENGTH, 'the later camera_info')
    assert client.exchange(*dots(), second=second).f == FOCAL_LENGTH


def test_a_bad_pair_gives_one_line_in_the_log(node, client):
    left, right = dots()
    right.height, right.data = 45, right.data[: 45 * WIDTH]
    for _ in range(5):
        client.publish_pair(left, right)
        client.exchange(*dots())
    assert node.log.count('rectify both to the same size') == 1


@pytest.mark.parametrize(('change', 'told'), [
    (lambda info: info.p.__setitem__(3, 0.0), 'f = 100, t = 0: right/camera_info has no baseline: P[3] is 0'),
    (lambda info: info.p.__setitem__(3, 20.0), 'left and right look swapped'),
    (lambda info: info.p.__setitem__(0, float('nan')), 'f = 0, t = 0: right/camera_info has a P matrix with NaN'),
    (lambda info: info.p.__setitem__(2, 1e6), 'principal points -999940 px apart in images 120 px wide'),
    (lambda info: setattr(info, 'width', 1000), 'tells of 1000x90 px, the image has 120x90'),
])
def test_a_bad_camera_info_is_told_and_the_disparity_still_published(client, change, told):
    info = camera_info('right')
    change(info)
    client.publish('right/camera_info', info)
    client.exchange_until(*dots(), lambda message: message.t == 0, 'the new camera_info')
    client.wait_for_trouble(told, each=lambda: client.publish_pair(*dots()))


def test_the_baseline_parameter_replaces_a_missing_one(client):
    client.publish('right/camera_info', camera_info('right', baseline=0.0))
    client.exchange_until(*dots(), lambda message: message.t == 0, 'the new camera_info')
    assert client.set_atomically(baseline=0.5).successful
    assert client.exchange(*dots()).t == 0.5


def test_diagnostics_count_what_came_and_went(client):
    client.exchange(*dots())
    del client.diagnostics[:]
    client.spin_until(lambda: len(client.diagnostics) >= 2, 'two diagnostics')
    counts = client.diagnostics[-1]
    assert int(counts['defects']) == 0
    assert int(counts['pairs']) >= int(counts['published']) >= 1
    assert int(counts['left images']) >= int(counts['pairs'])
    assert float(counts['latency p50 (ms)']) > 0
    assert float(counts['total (ms)']) > 0


@pytest.mark.parametrize(('queue_size', 'paired', 'unpaired'), [(3, 3, 0), (1, 1, 2)])
def test_as_many_images_wait_as_queue_size_says_and_the_others_are_counted(client, queue_size, paired, unpaired):
    assert client.set_atomically(queue_size=queue_size).successful
    before = client.counts()
    seconds = [client.next_second() for _ in range(3)]
    for side, message in zip(('left', 'right'), dots(), strict=True):
        for second in seconds:
            client.publish_image(side, message, second)
        came = before[f'{side} images'] + 3
        client.spin_until(lambda side=side, came=came: client.counts()[f'{side} images'] == came, f'all {side} images')
    after = client.counts()
    assert after['pairs'] - before['pairs'] == paired
    for side in ('left', 'right'):
        name = f'dropped: unpaired {side}'
        assert after[name] - before[name] == unpaired


def test_the_rate_is_that_of_the_time_that_has_passed(node, client):
    before = client.counts()
    for _ in range(8):
        client.exchange(*dots())
    node.send(signal.SIGSTOP)
    time.sleep(3.0)
    node.send(signal.SIGCONT)
    after = client.counts()
    published = after['published'] - before['published']
    assert published >= 8
    assert after['rate (Hz)'] < published / 2.9
