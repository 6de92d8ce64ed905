"""images_to_bag: what is in the bag, by rosbags and by the real message types; and what is refused."""
import os
import resource
import shutil
import signal
import subprocess
import sys
import time
import warnings
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml
from calibrations import EUROC_SIZE, MIDDLEBURY, euroc_documents, write_euroc, write_kitti
from checkout import CHECKOUT
from rclpy.serialization import deserialize_message, serialize_message
from rosbags.highlevel import AnyReader
from scene_files import files_of, write_pfm
from sensor_msgs.msg import CameraInfo, Image
from stereo_msgs.msg import DisparityImage

from svdm_ros.bags import images_to_bag
from svdm_ros.calibration.geometry import stereo_geometry
from svdm_ros.frames.image_conversion import image_to_array

with warnings.catch_warnings():  # comes with the first message, from the parser behind the messages
    warnings.simplefilter('ignore', DeprecationWarning)
    import rosidl_generator_py  # noqa: F401

TYPES = {'image_rect': Image, 'camera_info': CameraInfo, 'disparity': DisparityImage}
SIDES = ('left', 'right')
SIZE = (48, 32)
SECOND = 10**9


def random_image(seed, kind='grey', size=SIZE):
    shape = size[::-1] if kind != 'colour' else (*size[::-1], 3)
    dtype = np.uint16 if kind == 'deep' else np.uint8
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


def write_images(folder, names, kind='grey', size=SIZE):
    """folder/left and folder/right with a random image of each name; the images by (side, position)."""
    images = {}
    for side in SIDES:
        (folder / side).mkdir(parents=True, exist_ok=True)
        for position, name in enumerate(names):
            images[side, position] = random_image(len(images), kind, size)
            assert cv2.imwrite(str(folder / side / name), images[side, position])
    return images


def convert(folder, *arguments, left='left', right='right', calib='calib.txt'):
    """Run the command on what is in `folder`, to folder/bag; the exit code."""
    return images_to_bag.main([str(folder / left), str(folder / right), '--calib', str(folder / calib),
                               str(folder / 'bag'), *map(str, arguments)])


def read(bag):
    """Topic -> [(time in ns, message of rclpy)], and that rclpy would write as many bytes (padding has no value)."""
    topics = {}
    with AnyReader([bag]) as reader:
        for connection, stamp, data in reader.messages():
            kind = TYPES[connection.topic.rpartition('/')[2]]
            message = deserialize_message(bytes(data), kind)
            assert len(serialize_message(message)) == len(data)
            topics.setdefault(connection.topic, []).append((stamp, message))
    return topics


def stamps(messages):
    return [message.header.stamp.sec * SECOND + message.header.stamp.nanosec for _, message in messages]


@pytest.fixture
def pairs(tmp_path):
    """Three grey pairs with a calibration of KITTI."""
    write_images(tmp_path, ['000000.png', '000001.png', '000002.png'])
    write_kitti(tmp_path, 'odometry')
    return tmp_path


# What is in the bag


@pytest.mark.parametrize(('kind', 'encoding'), [('grey', 'mono8'), ('colour', 'bgr8'), ('deep', 'mono16')])
def test_every_pixel_and_every_field(tmp_path, kind, encoding):
    images = write_images(tmp_path, ['1.png', '2.png', '10.png'], kind)
    write_kitti(tmp_path, 'odometry')
    assert convert(tmp_path) == 0
    topics = read(tmp_path / 'bag')
    assert set(topics) == {f'/{side}/{name}' for side in SIDES for name in ('image_rect', 'camera_info')}
    for side in SIDES:
        messages = topics[f'/{side}/image_rect']
        for position, (time_ns, message) in enumerate(messages):
            np.testing.assert_array_equal(image_to_array(message), images[side, position])
            assert (message.encoding, message.header.frame_id) == (encoding, 'camera_left_optical')
            assert time_ns == SECOND + position * SECOND // 10
        assert stamps(messages) == [time_ns for time_ns, _ in messages] == stamps(topics[f'/{side}/camera_info'])


def test_the_node_understands_the_camera_info(pairs):
    assert convert(pairs) == 0
    topics = read(pairs / 'bag')
    left, right = (topics[f'/{side}/camera_info'][0][1] for side in SIDES)
    assert (left.width, left.height, left.distortion_model) == (*SIZE, 'plumb_bob')
    assert list(left.d) == [0.0] * 5
    assert list(right.k) == [700.0, 0.0, 600.0, 0.0, 700.0, 180.0, 0.0, 0.0, 1.0]
    assert list(right.r) == np.eye(3).ravel().tolist()
    geometry = stereo_geometry(left, right, *SIZE)
    assert (geometry.focal_length, geometry.baseline) == (700.0, pytest.approx(0.54))
    assert (geometry.principal_offset, geometry.problem) == (0.0, '')


def test_colour_folders_of_kitti_have_the_calibration_of_the_colour_cameras(tmp_path):
    write_images(tmp_path, ['0.png'])  # grey files in the folders of the colour cameras
    for side, name in (('left', 'image_2'), ('right', 'image_3')):
        (tmp_path / side).rename(tmp_path / name)
    write_kitti(tmp_path, 'odometry')
    assert convert(tmp_path, left='image_2', right='image_3') == 0
    right = read(tmp_path / 'bag')['/right/camera_info'][0][1]
    assert right.p[3] == pytest.approx(-378)
    assert -right.p[3] / right.p[0] == pytest.approx((336 + 42) / 700)


def test_storages_and_compressions_hold_the_same_messages(pairs):
    held = []
    for storage in ('mcap', 'sqlite3'):
        for compression in ('none', 'zstd'):
            assert convert(pairs, '--storage', storage, '--compression', compression) == 0
            metadata = yaml.safe_load((pairs / 'bag' / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
            assert metadata['storage_identifier'] == storage
            [file] = metadata['relative_file_paths']
            assert file == {'mcap': 'bag.mcap', 'sqlite3': 'bag.db3'}[storage]
            assert all(topic['topic_metadata']['offered_qos_profiles'][0]['reliability'] == 'reliable'
                       for topic in metadata['topics_with_message_count'])
            with AnyReader([pairs / 'bag']) as reader:
                held.append([(connection.topic, stamp, bytes(data)) for connection, stamp, data in reader.messages()])
            shutil.rmtree(pairs / 'bag')
    assert len(held[0]) == 12
    assert all(other == held[0] for other in held)


def test_compression_makes_a_file_smaller(tmp_path):
    (tmp_path / 'left').mkdir()
    cv2.imwrite(str(tmp_path / 'left' / 'flat.png'), np.zeros((400, 600), np.uint8))
    shutil.copytree(tmp_path / 'left', tmp_path / 'right')
    write_kitti(tmp_path, 'odometry')
    for storage, file in (('mcap', 'bag.mcap'), ('sqlite3', 'bag.db3')):
        assert convert(tmp_path, '--force', '--storage', storage, '--compression', 'zstd') == 0
        assert (tmp_path / 'bag' / file).stat().st_size < 60_000


def test_a_middlebury_scene_at_half_its_calibrated_size(tmp_path, capsys):
    """Depth by the messages is f * baseline / (d + doffs) of the calibration, whatever the scale."""
    for name in ('im0.png', 'im1.png'):
        cv2.imwrite(str(tmp_path / name), random_image(1, 'colour', (400, 300)))
    truth = np.random.default_rng(1).uniform(3, 60, (300, 400)).astype(np.float32)
    truth[:5] = np.inf
    write_pfm(tmp_path / 'disp0.pfm', truth)
    (tmp_path / 'calib.txt').write_text(MIDDLEBURY)
    assert convert(tmp_path, '--ground-truth', tmp_path / 'disp0.pfm', left='im0.png', right='im1.png') == 0
    assert '1 pair of 400x300 px in bgr8, ground truth for 1; f 500 px, baseline 0.2 m' in capsys.readouterr().out
    topics = read(tmp_path / 'bag')
    [(_, message)] = topics['/ground_truth/disparity']
    values = np.frombuffer(message.image.data, np.float32).reshape(300, 400)
    known = values >= message.min_disparity
    np.testing.assert_array_equal(known, np.isfinite(truth))
    np.testing.assert_allclose(message.f * message.t / values[known], 500 * 0.2 / (truth[known] + 25), rtol=1e-5)
    assert values[known].max() < message.max_disparity
    assert message.header == topics['/left/image_rect'][0][1].header
    geometry = stereo_geometry(*(topics[f'/{side}/camera_info'][0][1] for side in SIDES), 400, 300)
    assert (message.f, message.t) == pytest.approx((geometry.focal_length, geometry.baseline))
    assert geometry.principal_offset == -25


def test_ground_truth_of_kitti_where_there_is_one(pairs):
    (pairs / 'truth').mkdir()
    steps = np.full(SIZE[::-1], 1280, np.uint16)
    steps[0] = 0
    cv2.imwrite(str(pairs / 'truth' / '000001.png'), steps)
    assert convert(pairs, '--ground-truth', pairs / 'truth') == 0
    [(time_ns, message)] = read(pairs / 'bag')['/ground_truth/disparity']
    assert time_ns == SECOND + SECOND // 10
    values = np.frombuffer(message.image.data, np.float32).reshape(SIZE[::-1])
    assert (values[1:] == 5.0).all()
    assert message.min_disparity < 5.0 < message.max_disparity  # strictly, as some readers test
    assert (values[0] < message.min_disparity).all()


def test_raw_images_of_euroc_come_out_rectified(tmp_path, capsys):
    """Blobs where a raw camera sees points: in the bag they are in equal rows, as far apart as their depth says."""
    left, right = write_euroc(tmp_path)
    points = np.array([[-0.9, -0.5, 3], [0.8, -0.3, 4], [0.1, 0.05, 2.5], [-0.6, 0.5, 5], [1.0, 1.1, 6]])
    body_from_left = np.reshape(euroc_documents()[0]['T_BS']['data'], (4, 4))
    for camera, document in zip((left.parent, right.parent), euroc_documents(), strict=True):
        own = np.linalg.inv(np.reshape(document['T_BS']['data'], (4, 4))) @ body_from_left
        f_x, f_y, c_x, c_y = document['intrinsics']
        raw = cv2.projectPoints(points, cv2.Rodrigues(own[:3, :3])[0], own[:3, 3].copy(),
                                np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]),
                                np.array(document['distortion_coefficients']))[0][:, 0]
        rows, columns = np.mgrid[:EUROC_SIZE[1], :EUROC_SIZE[0]]
        blobs = sum(np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 18) for x, y in raw)
        (camera / 'data').mkdir()
        cv2.imwrite(str(camera / 'data' / '1403636579763555584.png'), np.rint(250 * blobs).astype(np.uint8))
    assert convert(tmp_path, left='cam0/data', right='cam1/data', calib='cam0/sensor.yaml') == 0
    assert 'rectified here by the calibration of EuRoC' in capsys.readouterr().out
    topics = read(tmp_path / 'bag')
    infos = [topics[f'/{side}/camera_info'][0][1] for side in SIDES]
    assert list(infos[0].d[:4]) == euroc_documents()[0]['distortion_coefficients']
    geometry = stereo_geometry(*infos, *EUROC_SIZE)
    assert (geometry.baseline, geometry.problem) == (pytest.approx(0.11), '')
    depth = sorted((points @ np.reshape(infos[0].r, (3, 3)).T)[:, 2])
    seen = [blob_centres(image_to_array(topics[f'/{side}/image_rect'][0][1])) for side in SIDES]
    assert stamps(topics['/left/image_rect']) == [1403636579763555584]
    np.testing.assert_allclose(seen[0][:, 1], seen[1][:, 1], atol=0.1)
    disparity = seen[0][:, 0] - seen[1][:, 0]
    expected = geometry.focal_length * geometry.baseline / np.array(depth)
    np.testing.assert_allclose(sorted(disparity, reverse=True), expected, atol=0.15)


def blob_centres(image):
    """(N, 2) px, by row."""
    count, labels = cv2.connectedComponents((image > 25).astype(np.uint8))
    centres = []
    for label in range(1, count):
        rows, columns = np.nonzero(labels == label)
        weights = image[rows, columns].astype(float)
        centres.append((np.average(columns, weights=weights), np.average(rows, weights=weights)))
    return np.array(sorted(centres, key=lambda centre: centre[1]))


# Which images, and when


def test_times_of_kitti(pairs):
    (pairs / 'times.txt').write_text('0.000000e+00\n1.036224e-01\n2.072000e-01\n')
    assert convert(pairs) == 0
    assert stamps(read(pairs / 'bag')['/left/image_rect']) == [0, 103622400, 207200000]


def test_times_of_kitti_raw(pairs):
    (pairs / 'timestamps.txt').write_text('2011-09-26 13:02:25.964389445\n2011-09-26 13:02:26.074343\n'
                                          '2011-09-26 13:02:27\n')
    assert convert(pairs) == 0
    assert stamps(read(pairs / 'bag')['/left/image_rect']) == [
        1317042145964389445, 1317042146074343000, 1317042147000000000]


def test_a_rate_replaces_the_times(pairs):
    (pairs / 'times.txt').write_text('1\n2\n3\n')
    assert convert(pairs, '--rate', '4') == 0
    assert np.diff(stamps(read(pairs / 'bag')['/left/image_rect'])).tolist() == [SECOND // 4] * 2


def test_names_that_differ_are_paired_in_natural_order(tmp_path):
    images = write_images(tmp_path, ['2.png', '10.png'])
    for name in ('2.png', '10.png'):
        (tmp_path / 'right' / name).rename(tmp_path / 'right' / f'right_{name}')
    write_kitti(tmp_path, 'odometry')
    assert convert(tmp_path) == 0
    messages = read(tmp_path / 'bag')['/right/image_rect']
    for position, (_, message) in enumerate(messages):
        np.testing.assert_array_equal(image_to_array(message), images['right', position])


def test_stamped_images_without_a_partner_are_left_out_and_told(tmp_path, capsys):
    names = [f'14036365797{n}555584.png' for n in range(10, 14)]
    write_images(tmp_path, names)
    write_kitti(tmp_path, 'odometry')
    (tmp_path / 'left' / names[1]).unlink()
    (tmp_path / 'right' / names[3]).unlink()
    assert convert(tmp_path) == 1
    assert stamps(read(tmp_path / 'bag')['/left/image_rect']) == [int(names[0][:-4]), int(names[2][:-4])]
    told = capsys.readouterr().err.splitlines()
    assert [names[3] in told[0], names[1] in told[1], len(told)] == [True, True, 2]


# What is refused


def truncate(path):
    path.write_bytes(path.read_bytes()[:200])


def resize(path):
    cv2.imwrite(str(path), random_image(1, size=(40, 32)))


def recolour(path):
    cv2.imwrite(str(path), random_image(1, 'colour'))


def write_float(path):
    cv2.imwrite(str(path.with_suffix('.tiff')), np.ones(SIZE[::-1], np.float32))
    path.unlink()


@pytest.mark.parametrize(('spoil', 'path', 'told'), [
    (Path.unlink, 'right/000001.png', 'left/000001.png has no partner of its name on the other side, as 1 of 5'),
    (lambda path: path.rename(path.with_name('3.png')), 'right/000001.png', 'left/000001.png has no partner'),
    (lambda path: [file.rename(file.with_name(f'r{file.name}')) for file in path.parent.glob('*[01].png')]
     and path.unlink(), 'right/000002.png', 'left has 3 images and'),
    (truncate, 'left/000001.png', 'left/000001.png: a truncated PNG'),
    (resize, 'right/000002.png', 'right/000002.png has 40x32 px in mono8, the first left image 48x32 in mono8'),
    (recolour, 'right/000000.png', 'right/000000.png has 48x32 px in bgr8'),
    (write_float, 'left/000002.png', '000002.tiff: an image of float32'),
    (Path.unlink, 'calib.txt', 'calib.txt: there is no such file'),
    (lambda path: path.write_text('P0: 1'), 'calib.txt', 'calib.txt: P0 has 1 numbers'),
    (lambda path: path.write_text('1\n2\n'), 'times.txt', 'times.txt has 2 times for 3 pairs'),
    (lambda path: path.write_text('1\n2\n2\n'), 'times.txt', 'the time of line 3, 2, is not after the one before'),
    (lambda path: path.write_text('1\nx\n2\n'), 'times.txt', "line 2 is 'x'"),
    (shutil.rmtree, 'right', 'right: there is no such folder'),
])
def test_one_line_tells_what_is_wrong_and_nothing_is_written(pairs, capsys, spoil, path, told):
    spoil(pairs / path)
    before = files_of(pairs)
    assert convert(pairs) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith('images_to_bag: ')
    assert told in line
    assert files_of(pairs) == before


@pytest.mark.parametrize(('arguments', 'told'), [
    (['--ground-truth', 'nowhere'], 'nowhere: there is no such folder'),
    (['--ground-truth', '.'], 'no .png or .pfm in it is named like a left image'),
    (['--calib', 'calib.txt'], 'is the calibration of both cameras: give --calib once'),
])
def test_arguments_that_do_not_fit(pairs, capsys, monkeypatch, arguments, told):
    monkeypatch.chdir(pairs)
    assert convert(pairs, *arguments) == 2
    [line] = capsys.readouterr().err.splitlines()
    assert told in line
    assert not (pairs / 'bag').exists()


@pytest.mark.parametrize('arguments', [['--rate', '0'], ['--rate', 'nan'], ['--storage', 'bag'],
                                       ['--compression', 'x']])
def test_values_that_are_not_allowed(pairs, arguments):
    with pytest.raises(SystemExit) as refused:
        convert(pairs, *arguments)
    assert refused.value.code == 2


def test_ground_truth_of_another_size_is_refused(pairs, capsys):
    (pairs / 'truth').mkdir()
    write_pfm(pairs / 'truth' / '000000.pfm', np.ones((4, 5), np.float32))
    assert convert(pairs, '--ground-truth', pairs / 'truth') == 2
    assert 'has 5x4 px, the images have 48x32' in capsys.readouterr().err


def test_only_a_bag_is_replaced_and_only_when_told(pairs, capsys):
    assert convert(pairs) == 0
    before = files_of(pairs)
    assert convert(pairs, '--rate', '5') == 2
    assert 'bag exists already' in capsys.readouterr().err
    assert files_of(pairs) == before
    (pairs / 'calib.txt').rename(pairs / 'mine.txt')
    assert convert(pairs, '--force') == 2
    assert (pairs / 'bag' / 'bag.mcap').read_bytes() == before[pairs / 'bag' / 'bag.mcap']
    assert convert(pairs, '--force', '--rate', '5', calib='mine.txt') == 0
    assert np.diff(stamps(read(pairs / 'bag')['/left/image_rect'])).tolist() == [SECOND // 5] * 2
    assert sorted(path.name for path in pairs.iterdir()) == ['bag', 'left', 'mine.txt', 'right']
    (pairs / 'bag' / 'metadata.yaml').unlink()
    assert convert(pairs, '--force', calib='mine.txt') == 2
    assert 'is no bag' in capsys.readouterr().err


def run_process(folder, **options):
    return subprocess.Popen(
        [sys.executable, '-m', 'svdm_ros.bags.images_to_bag', str(folder / 'left'), str(folder / 'right'), '--calib',
         str(folder / 'calib.txt'), str(folder / 'bag')],
        cwd=CHECKOUT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True, **options)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_an_interrupted_run_leaves_nothing(pairs, number):
    for side in SIDES:
        for copy in range(3000):
            os.link(pairs / side / '000000.png', pairs / side / f'1{copy:05}.png')
    process = run_process(pairs)
    try:
        end = time.monotonic() + 30
        while not list(pairs.glob('.bag.*/bag/bag.mcap')):
            assert process.poll() is None and time.monotonic() < end
            time.sleep(0.005)
        process.send_signal(number)
        assert process.communicate(timeout=20)[1] == 'images_to_bag: interrupted, nothing was written\n'
        assert process.returncode == 130
    finally:
        process.kill()
        process.communicate()
    assert sorted(path.name for path in pairs.iterdir()) == ['calib.txt', 'left', 'right']


def test_a_full_disk_is_told_in_one_line(tmp_path):
    write_images(tmp_path, [f'{n}.png' for n in range(8)], size=(800, 600))
    write_kitti(tmp_path, 'odometry')
    limit = 4 * 2**20  # bytes a file may have
    process = run_process(tmp_path, preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit)))
    _, told = process.communicate(timeout=60)
    assert process.returncode == 2
    assert told.splitlines() == ['images_to_bag: output: File too large']
    assert sorted(path.name for path in tmp_path.iterdir()) == ['calib.txt', 'left', 'right']


def test_no_ros_is_needed(pairs):
    code = f'''
import sys
from svdm_ros.bags import images_to_bag
images_to_bag.main([{str(pairs / "left")!r}, {str(pairs / "right")!r}, "--calib", {str(pairs / "calib.txt")!r},
                    {str(pairs / "bag")!r}])
print(sorted(name for name in sys.modules if name.partition(".")[0] in ("rclpy", "sensor_msgs", "stereo_msgs")))'''
    run = subprocess.run([sys.executable, '-c', code], cwd=CHECKOUT, capture_output=True, text=True, timeout=60)
    assert run.stdout.splitlines()[-1] == '[]', run.stdout + run.stderr


@pytest.mark.skipif('SVDM_DATA' not in os.environ, reason='SVDM_DATA names no folder with kitti_odometry_seq1')
def test_the_real_sequence_becomes_a_bag(tmp_path):
    sequence = Path(os.environ['SVDM_DATA']) / 'kitti_odometry_seq1'
    assert images_to_bag.main([str(sequence / 'left'), str(sequence / 'right'), '--calib', str(sequence / 'calib.txt'),
                               str(tmp_path / 'bag')]) == 0
    topics = read(tmp_path / 'bag')
    assert {topic: len(messages) for topic, messages in topics.items()} == {
        f'/{side}/{name}': 51 for side in SIDES for name in ('image_rect', 'camera_info')}
    for side in SIDES:
        for file, (_, message) in zip(sorted((sequence / side).iterdir()), topics[f'/{side}/image_rect'], strict=True):
            np.testing.assert_array_equal(image_to_array(message), cv2.imread(str(file), cv2.IMREAD_UNCHANGED))
    geometry = stereo_geometry(*(topics[f'/{side}/camera_info'][0][1] for side in SIDES), 1226, 370)
    assert (geometry.focal_length, geometry.baseline) == pytest.approx((707.0912, 0.53715), rel=1e-5)
