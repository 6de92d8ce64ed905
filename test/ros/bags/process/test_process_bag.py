"""process_bag: every pair in, every disparity out, the same bytes every time."""
import itertools
import json
import os
import shutil
from pathlib import Path

import cv2
import numpy as np
import planes
import pytest
import recordings
from raw_recordings import RAW_SIZE, raw_infos, raw_recording
from recordings import (
    LEFT,
    LEFT_INFO,
    MS,
    OFFSET,
    PERIOD,
    RIGHT,
    RIGHT_INFO,
    ROS1,
    ROS2,
    F,
    T,
    camera_info,
    compressed,
    contents,
    image,
    messages_of,
    scene,
    stamp,
    stereo,
    write,
    write_ros1,
)

from svdm_core import MatcherParameters, StereoMatcher
from svdm_ros.bags.process.processing import Job, process
from svdm_ros.bags.reading.recording import open_recording
from svdm_ros.calibration.stereo_calibration import CameraCalibration, StereoCalibration, rectified_camera
from svdm_ros.frames.frame_processing import FrameProcessor
from svdm_ros.frames.messages import disparity_image, rclpy_types
from svdm_ros.frames.views import StereoFrame
from svdm_ros.node.parameter_set import NodeParameters

pytest_plugins = ['process_bag_fixtures']

DISPARITY, DEPTH, DEPTH_INFO = '/disparity', '/depth/image_rect', '/depth/camera_info'
PARAMETERS = MatcherParameters(num_disparities=16)


def values(message, field='image'):
    stored = getattr(message, field) if field else message
    return np.frombuffer(stored.data, np.float32).reshape(stored.height, stored.width)


def test_every_pair_has_the_disparity_of_the_matcher_with_time_stamp_and_frame_of_its_left_image(bag, run, tmp_path):
    assert '5 disparities of 5 pairs' in run(bag)
    found = messages_of(tmp_path / 'out', DISPARITY)
    assert [time_ns for time_ns, _ in found] == [stamp(index) + 3 * MS for index in range(5)]
    matcher = StereoMatcher(PARAMETERS)
    for index, (_, message) in enumerate(found):
        assert message.header == message.image.header == recordings.header(stamp(index))
        assert (message.f, message.t) == (F, T)
        np.testing.assert_array_equal(values(message), matcher.compute(*scene(index)).disparity - np.float32(OFFSET))


def side_by_side(count):
    """The recording of a camera that sends both views of `scene` in one image, beside a copy of it."""
    for topic, time_ns, message in stereo(count):
        if topic in (LEFT_INFO, RIGHT_INFO):
            yield topic.replace('/cam/', '/usb/'), time_ns, message
        elif topic == LEFT:
            both = np.hstack(scene(round((time_ns - stamp(0)) / PERIOD)))
            yield '/usb/image_rect', time_ns, image(both, time_ns - 3 * MS)
            yield '/usb/image_rect/compressed', time_ns, compressed(both, time_ns - 3 * MS)


def test_images_of_both_views_give_the_messages_of_two_images(run, tmp_path):
    run(write(tmp_path / 'separate', stereo(2)), '--outputs', 'disparity,depth', output='two')
    whole = write(tmp_path / 'whole', side_by_side(2))
    layout = '--set', 'layout=side_by_side'
    told = run(whole, *layout, '--outputs', 'disparity,depth')
    assert 'out: 2 disparities of 2 pairs' in told
    with open_recording(tmp_path / 'out') as one, open_recording(tmp_path / 'two') as two:
        for topic in (DISPARITY, DEPTH, DEPTH_INFO):
            both = [[(message.time_ns, message.data) for message in bag.messages([topic])] for bag in (one, two)]
            assert len(both[0]) == 2 and both[0] == both[1]
        assert {'/usb/left/camera_info', '/usb/right/camera_info'} < set(one.topics)
    run(whole, *layout, '--left', '/usb/image_rect/compressed', '--copy-inputs', output='packed')
    found = [message.data for _, message in messages_of(tmp_path / 'packed', '/usb/image_rect/compressed')]
    assert len(found) == 2
    for name in ('out', 'packed'):
        disparities = [values(message) for _, message in messages_of(tmp_path / name, DISPARITY)]
        np.testing.assert_array_equal(disparities[0], values(messages_of(tmp_path / 'two', DISPARITY)[0][1]))
    told = run(whole, *layout, '--right', '/b', output='none', code=2)
    assert '--right /b is not allowed with layout = side_by_side' in told


def test_a_calibration_for_images_of_both_views_is_written_for_each_side(tmp_path):
    sides = [rectified_camera((90, 60), np.reshape(camera_info(side, 0).p, (3, 4))) for side in ('left', 'right')]
    whole = write(tmp_path / 'whole', [entry for entry in side_by_side(1) if 'info' not in entry[0]])
    process(Job(whole, tmp_path / 'out', NodeParameters(PARAMETERS, layout='side_by_side'),
                calibration=StereoCalibration(*sides, 'a test', is_rectified=True)))
    [(_, message)] = messages_of(tmp_path / 'out', DISPARITY)
    assert (message.f, message.t) == (F, T)
    for side, camera in zip(('left', 'right'), sides, strict=True):
        [(_, info)] = messages_of(tmp_path / 'out', f'/usb/{side}/camera_info')
        np.testing.assert_array_equal(info.p, camera.p.ravel())


@pytest.mark.filterwarnings("ignore:module 'sre_:DeprecationWarning")  # of what rclpy imports
def test_the_bytes_are_those_of_the_node(bag, run, tmp_path):
    """The node's way from the same images: rclpy's classes in, rclpy's classes out, rclpy's serialization."""
    from rclpy.serialization import deserialize_message, serialize_message
    from sensor_msgs.msg import CameraInfo, Image

    run(bag)
    kinds = {LEFT: Image, RIGHT: Image, LEFT_INFO: CameraInfo, RIGHT_INFO: CameraInfo}
    with open_recording(bag) as recording:
        came = {topic: [deserialize_message(message.data, kind) for message in recording.messages([topic])]
                for topic, kind in kinds.items()}
    processor, parameters = FrameProcessor(), NodeParameters(PARAMETERS)
    with open_recording(tmp_path / 'out') as recording:
        for message, *frame in zip(recording.messages([DISPARITY]), *came.values(), strict=True):
            matched = processor.process(StereoFrame(*frame, arrived=0.0), parameters).frame
            published = serialize_message(disparity_image(matched, rclpy_types()))
            assert len(published) == len(message.data)
            # rclpy leaves in the padding between fields what was there before; rosbags writes zeros.
            fields = ROS2.deserialize_cdr(published, message.message_type)
            assert ROS2.serialize_cdr(fields, message.message_type) == message.data


def test_camera_info_comes_along_and_the_images_where_they_are_wanted(bag, run, tmp_path):
    run(bag)
    infos = [entry for entry in contents(bag) if entry[0] in (LEFT_INFO, RIGHT_INFO)]
    assert [entry for entry in contents(tmp_path / 'out') if entry[0] != DISPARITY] == infos
    run(bag, '--copy-inputs', output='copy')
    copied = contents(tmp_path / 'copy')
    assert [entry for entry in copied if entry[0] != DISPARITY] == contents(bag)
    assert sum(entry[0] == DISPARITY for entry in copied) == 5


@pytest.mark.parametrize(('storage', 'compression', 'options'), [
    ('mcap', 'storage', ()), ('mcap', 'message', ()), ('sqlite3', None, ()), ('sqlite3', 'file', ()),
    ('mcap', None, ('--set', 'num_threads=1'))])
def test_storage_compression_and_threads_change_no_byte(bag, run, tmp_path, storage, compression, options):
    run(bag, output='expected')
    run(write(tmp_path / 'input', stereo(5), storage, compression), *options)
    assert contents(tmp_path / 'out') == contents(tmp_path / 'expected')


def test_a_ros1_bag_gives_the_same(bag, run, tmp_path):
    run(bag, '--copy-inputs', output='expected')
    run(write_ros1(tmp_path / 'a.bag', stereo(5, types=ROS1)), '--copy-inputs')
    assert contents(tmp_path / 'out') == contents(tmp_path / 'expected')


@pytest.mark.parametrize('suffix', ['png', 'jpg'])
def test_compressed_images_are_decoded(run, tmp_path, suffix):
    def colour(index):
        return [np.stack([grey, grey, grey], axis=2) for grey in scene(index)]

    topics = {LEFT: f'{LEFT}/compressed', RIGHT: f'{RIGHT}/compressed'}
    plain = list(stereo(2, pixels=colour))
    packed = [(topics.get(topic, topic), time_ns, message if topic not in topics else compressed(
        message.data.reshape(60, 90, 3), stamp(index // 4), suffix, 'bgr8'))
        for index, (topic, time_ns, message) in enumerate(plain)]
    run(write(tmp_path / 'packed', packed))
    matcher = StereoMatcher(PARAMETERS)
    for index, (_, message) in enumerate(messages_of(tmp_path / 'out', DISPARITY)):
        decoded = [cv2.imdecode(cv2.imencode(f'.{suffix}', pixels)[1], cv2.IMREAD_COLOR) for pixels in colour(index)]
        np.testing.assert_array_equal(values(message), matcher.compute(*decoded).disparity - np.float32(OFFSET))
        assert (message.f, message.t) == (F, T)


def test_depth_is_z_with_the_camera_info_of_the_left_image(bag, run, tmp_path):
    run(bag, '--outputs', 'depth,disparity', '--set', 'publish_filled=false')
    disparities, depths, infos = (messages_of(tmp_path / 'out', topic) for topic in (DISPARITY, DEPTH, DEPTH_INFO))
    assert len(depths) == len(infos) == 5
    for (_, disparity), (_, depth), (_, info) in zip(disparities, depths, infos, strict=True):
        assert depth.encoding == '32FC1' and depth.header == info.header == disparity.header
        pixels = values(disparity)
        valid = (pixels >= disparity.min_disparity) & (pixels > 0)
        assert 0.3 < valid.mean() < 1
        np.testing.assert_allclose(values(depth, None)[valid], F * T / pixels[valid], rtol=1e-6)
        assert np.isnan(values(depth, None)[~valid]).all()
        np.testing.assert_allclose(info.p, camera_info('left', 0).p, rtol=1e-12)
        assert (info.width, info.height) == (depth.width, depth.height)


def test_start_and_duration_cut_a_part_out(bag, run, tmp_path):
    run(bag, '--start', '0.1', '--duration', '0.2')
    assert [time_ns for time_ns, _ in messages_of(tmp_path / 'out', DISPARITY)] == [
        stamp(index) + 3 * MS for index in (1, 2)]


def test_the_camera_info_of_the_same_stamp_counts_and_the_first_one_before_there_is_any(run, tmp_path):
    """A zoom: the focal length differs from pair to pair; the first two pairs came before any camera_info."""
    entries = []
    for index in range(6):
        now = stamp(index)
        left, right = scene(index)
        entries += [(LEFT, now, image(left, now)), (RIGHT, now + MS, image(right, now))]
        if index > 1:
            entries += [(topic, now + 90 * MS, camera_info(side, now, focal=F + index))
                        for side, topic in (('left', LEFT_INFO), ('right', RIGHT_INFO))]
    run(write(tmp_path / 'bag', entries))
    assert [message.f for _, message in messages_of(tmp_path / 'out', DISPARITY)] == [
        F + index for index in (2, 2, 2, 3, 4, 5)]


def test_the_error_against_ground_truth_is_told(run, tmp_path):
    run(write(tmp_path / 'bag', stereo(3)), output='first')
    truths = []
    for time_ns, message in messages_of(tmp_path / 'first', DISPARITY):
        wrong = values(message).copy()
        wrong[:30] += 5
        message.image.data = wrong.ravel().view(np.uint8)
        truths.append(('/ground_truth/disparity', time_ns + 20 * MS, message))
    entries = sorted([*stereo(3), *truths], key=lambda entry: entry[1])
    told = run(write(tmp_path / 'judged', entries))
    error = json.loads((tmp_path / 'out' / 'summary.json').read_text())['ground_truth']
    first = [values(message) for _, message in messages_of(tmp_path / 'first', DISPARITY)]
    known = np.concatenate([np.where(np.arange(60)[:, None] < 30, pixels + 5, pixels) > 0 for pixels in first])
    shifted = np.concatenate([np.arange(60)[:, None] < 30 + 0 * pixels for pixels in first])
    assert error['pixels'] == known.sum()
    assert error['mean_error_px'] == pytest.approx(5 * (known & shifted).sum() / known.sum(), rel=1e-5)
    assert error['bad_3px_percent'] == pytest.approx(100 * (known & shifted).sum() / known.sum(), rel=1e-5)
    assert 'against ground truth: mean error' in told


@pytest.mark.parametrize('kind', ['mp4', 'png'])
def test_a_preview_shows_every_disparity(bag, run, tmp_path, kind):
    run(bag, '--preview', kind, '--outputs', 'disparity,preview', '--set', 'publish_filled=false')
    live = [message.data.reshape(60, 90, 3) for _, message in messages_of(tmp_path / 'out', '/disparity/preview')]
    assert len(live) == 5 and all(frame.std() > 20 for frame in live)
    if kind == 'mp4':
        film = cv2.VideoCapture(str(tmp_path / 'out' / 'preview.mp4'))
        frames = list(itertools.takewhile(lambda frame: frame is not None, (film.read()[1] for _ in range(9))))
        assert int(film.get(cv2.CAP_PROP_FOURCC)).to_bytes(4, 'little') == b'VP90'  # browsers play it, no MPEG-4 part 2
        np.testing.assert_allclose(blurred(frames), blurred(live), atol=20)  # it is compressed with losses
    else:
        names = sorted((tmp_path / 'out' / 'preview').iterdir())
        assert [name.stem for name in names] == [str(stamp(index)) for index in range(5)]
        np.testing.assert_array_equal([cv2.imread(str(name)) for name in names], live)


def test_a_preview_shows_what_is_in_the_bag_and_the_topic_what_has_a_depth(bag, run, tmp_path):
    run(bag, '--preview', 'png', '--outputs', 'disparity,preview,depth,confidence')
    of = {topic: np.array([message.data for _, message in messages_of(tmp_path / 'out', topic)])
          for topic in ('/disparity/preview', '/depth/image_rect', '/confidence')}
    confident = of['/confidence'].view(np.float32) >= np.float32(0.2)
    assert 0.5 < confident.mean() < 1
    assert not np.isfinite(of['/depth/image_rect'].view(np.float32)[~confident]).any()
    pictures = np.array([cv2.imread(str(name)).reshape(-1, 3)
                         for name in sorted((tmp_path / 'out' / 'preview').iterdir())])
    assert pictures.any(axis=-1).all()
    np.testing.assert_array_equal(of['/disparity/preview'].reshape(pictures.shape), pictures * confident[..., None])


def blurred(frames):
    """Means of 10x10 px, float32."""
    return [cv2.resize(frame, (9, 6), interpolation=cv2.INTER_AREA).astype(np.float32) for frame in frames]


# Pairs, lone images


def test_lone_images_are_counted_and_no_pair_is_lost_to_a_queue(run, tmp_path):
    """The right camera is 30 pairs behind in the recording: more than the node would wait for."""
    entries = [(topic, time_ns + (3000 * MS if 'right' in topic else 0), message)
               for topic, time_ns, message in stereo(40)]
    entries = [entry for index, entry in enumerate(entries) if index not in (0, 42)]
    told = run(write(tmp_path / 'bag', sorted(entries, key=lambda entry: entry[1])))
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert (summary['pairs'], summary['disparities']) == (38, 38)
    assert summary['images'] == {'left': 39, 'right': 39}
    assert summary['unpaired'] == {'left': 1, 'right': 1}
    assert 'unpaired: 1 of 39 left, 1 of 39 right images: no partner of the same stamp' in told


def test_under_a_tolerance_the_last_pair_comes_out_too(run, tmp_path):
    entries = []
    for index in range(4):
        left, right = scene(index)
        late = stamp(index) + 40 * MS
        entries += [(LEFT, stamp(index), image(left, stamp(index))), (RIGHT, late, image(right, late))]
    bag = write(tmp_path / 'bag', entries)
    told = run(bag, code=2)
    assert f'no pair among 4 images on {LEFT} and 4 on {RIGHT}, the closest stamps are 0.04 s apart' in told
    assert list(tmp_path.iterdir()) == [bag]
    run(bag, '--set', 'approximate_sync_tolerance=0.06')
    assert len(messages_of(tmp_path / 'out', DISPARITY)) == 4


def test_a_recording_of_a_loop_gives_every_pass(run, tmp_path):
    entries = [(topic, time_ns + lap * 10 * PERIOD, message)
               for lap in range(3) for topic, time_ns, message in stereo(5)]
    run(write(tmp_path / 'bag', entries))
    assert len(messages_of(tmp_path / 'out', DISPARITY)) == 15


# The real sequence


@pytest.fixture(scope='module')
def kitti():
    folder = Path(os.environ.get('SVDM_DATA', 'unset')) / 'kitti_odometry_seq1'
    if not folder.is_dir():
        pytest.skip('SVDM_DATA names no folder with kitti_odometry_seq1')
    return [tuple(cv2.imread(str(folder / side / f'{index:06d}.png'), cv2.IMREAD_GRAYSCALE)[150:330:2, 200:800:2]
                  for side in ('left', 'right')) for index in range(51)]


def test_51_real_pairs_give_51_disparities_and_the_same_bytes_from_any_storage(kitti, run, tmp_path):
    found = []
    for name, storage, compression in (('raw', 'mcap', None), ('again', 'mcap', None), ('zstd', 'mcap', 'storage'),
                                       ('sql', 'sqlite3', None), ('sqlzstd', 'sqlite3', 'message')):
        bag = write(tmp_path / f'{name}_in', stereo(51, pixels=kitti.__getitem__), storage, compression)
        assert '51 disparities of 51 pairs' in run(bag, '--preset', 'fast', output=name)
        found.append(contents(tmp_path / name))
    assert len(found[0]) == 3 * 51
    assert all(one == found[0] for one in found[1:])


def median_error(depth):
    truth = planes.render(raw_infos()['left'], raw=False)[1]
    return np.median((np.abs(values(depth, None) - truth) / truth)[8:-8, 40:-8])


def test_raw_images_are_rectified_where_that_is_asked_for_and_told_where_not(run, tmp_path):
    bag = raw_recording(tmp_path / 'raw_bag', with_infos=True)
    topics = ('--left', '/left/image_raw', '--right', '/right/image_raw', '--set', 'num_disparities=32')
    assert 'input' in run(bag, *topics)
    shutil.rmtree(tmp_path / 'out')
    told = run(bag, *topics, 'input=raw', '--outputs', 'depth,rectified')
    assert 'in 2 pairs' not in told
    [(_, depth), _] = messages_of(tmp_path / 'out', DEPTH)
    assert median_error(depth) < 0.02
    assert len(messages_of(tmp_path / 'out', '/left/image_rect')) == 2


def test_raw_images_of_both_views_are_rectified_each_by_its_own_camera_info(run, tmp_path):
    bag = raw_recording(tmp_path / 'raw_bag', with_infos=True, together=True)
    run(bag, '--set', 'layout=side_by_side', 'input=raw', 'num_disparities=32', '--outputs', 'depth')
    [(_, depth), _] = messages_of(tmp_path / 'out', DEPTH)
    assert median_error(depth) < 0.02


def test_the_calibration_of_raw_cameras_rectifies_their_images(tmp_path):
    def camera(info):
        return CameraCalibration(RAW_SIZE, *(np.array(value, float).reshape(shape) for value, shape in (
            (info.k, (3, 3)), (info.d, -1), (info.r, (3, 3)), (info.p, (3, 4)))))

    bag = raw_recording(tmp_path / 'raw_bag', with_infos=False)
    calibration = StereoCalibration(*map(camera, raw_infos().values()), 'a test', is_rectified=False)
    parameters = NodeParameters().replace({'num_disparities': 32})
    summary = process(Job(bag, tmp_path / 'out', parameters, '/left/image_raw', '/right/image_raw',
                          outputs=('depth',), calibration=calibration))
    assert summary.exit_code == 0
    assert summary.progress.notes == {'the images were rectified by the calibration given': 2}
    [(_, depth), _] = messages_of(tmp_path / 'out', DEPTH)
    assert median_error(depth) < 0.02
