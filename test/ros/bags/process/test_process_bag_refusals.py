"""process_bag on what is wrong: recordings, disks, options. One line, and all that was finished is kept."""
import itertools
import json
import re
import resource
import subprocess
import sys

import numpy as np
import pytest
import recordings
from recordings import (
    BEGIN,
    LEFT,
    LEFT_INFO,
    MS,
    PERIOD,
    RIGHT,
    RIGHT_INFO,
    ROS2,
    SMALL,
    T,
    camera_info,
    contents,
    image,
    messages_of,
    scene,
    stamp,
    stereo,
    write,
)

from svdm_core import MatcherParameters, StereoMatcher, memory
from svdm_ros.bags.process import processing
from svdm_ros.bags.reading import pair_stream
from svdm_ros.bags.reading.stereo_topics import StereoTopics
from svdm_ros.bags.writing import partial_bag

pytest_plugins = ['process_bag_fixtures']

DISPARITY, DEPTH, DEPTH_INFO = '/disparity', '/depth/image_rect', '/depth/camera_info'
PARAMETERS = MatcherParameters(num_disparities=16)


def values(message, field='image'):
    stored = getattr(message, field) if field else message
    return np.frombuffer(stored.data, np.float32).reshape(stored.height, stored.width)


# What is wrong with a recording


def without(*topics):
    return [entry for entry in stereo(3) if entry[0] not in topics]


@pytest.mark.parametrize(('entries', 'told'), [
    (without(LEFT, RIGHT), f'bag: no images in it: it holds {LEFT_INFO}'),
    (without(RIGHT), f'bag: only one side: images on {LEFT} but none on {RIGHT}'),
    ([], 'bag: no images in it: it is empty'),
    ([(topic, time_ns, image(np.zeros((4, 8), np.float64), BEGIN, '64FC1')) for topic, time_ns, _ in without(
        LEFT_INFO, RIGHT_INFO)[:2]], "none of 1 pairs could be matched .*encoding '64FC1' is not supported"),
    ([(f'{topic}/compressed', time_ns, ROS2.types['sensor_msgs/msg/CompressedImage'](
        recordings.header(BEGIN), 'h264', np.arange(99, dtype=np.uint8))) for topic, time_ns, _ in without(
        LEFT_INFO, RIGHT_INFO)[:2]], "none of 1 pairs could be matched .*format 'h264'"),
])
def test_what_gives_nothing_is_refused_with_one_line_and_leaves_nothing(run, tmp_path, entries, told):
    bag = write(tmp_path / 'bag', entries)
    line = run(bag, code=2)
    assert re.search(told, line), line
    assert list(tmp_path.iterdir()) == [bag]


def test_without_camera_info_f_and_t_are_0_and_it_says_so(run, tmp_path):
    told = run(write(tmp_path / 'bag', stereo(3, infos=False)), '--outputs', 'disparity,depth')
    assert 'in 3 pairs: no left/camera_info and no right/camera_info received' in told
    assert [(message.f, message.t) for _, message in messages_of(tmp_path / 'out', DISPARITY)] == [(0, 0)] * 3
    assert all(np.isnan(values(message, None)).all() for _, message in messages_of(tmp_path / 'out', DEPTH))


def test_a_calibration_stands_in_for_camera_info(run, tmp_path):
    calib = tmp_path / 'calib.txt'
    calib.write_text('\n'.join(f'P{side}: {" ".join(map(str, camera_info(name, 0, focal=500.0).p))}'
                               for side, name in enumerate(('left', 'right'))))
    told = run(write(tmp_path / 'bag', stereo(3, infos=False)), '--calib', str(calib))
    assert 'camera_info' not in told
    assert {(message.f, message.t) for _, message in messages_of(tmp_path / 'out', DISPARITY)} == {(500.0, T)}
    infos = messages_of(tmp_path / 'out', RIGHT_INFO)
    assert [message.header for _, message in infos] == [recordings.header(stamp(index)) for index in range(3)]
    np.testing.assert_array_equal(infos[0][1].p, camera_info('right', 0, focal=500.0).p)


def test_sizes_and_encodings_that_change_half_way_cost_only_the_pairs_they_concern(run, tmp_path):
    def pixels(index):
        left, right = scene(index)
        if index == 2:
            return left, right[:-1]
        if index == 3:
            return left[:50], right[:50]  # both: no harm
        return left, right

    entries = list(stereo(6, pixels=pixels))
    entries[16] = (entries[16][0], entries[16][1], image(scene(4)[0].astype(np.uint16), stamp(4), 'mono16'))
    told = run(write(tmp_path / 'bag', entries), code=1)
    assert '4 disparities of 6 pairs' in told
    assert '1 without disparity, the first: pair dropped: the left image has 90x60 px, the right 90x59' in told
    assert 'the left image is mono16, the right mono8' in told
    assert [values(message).shape[0] for _, message in messages_of(tmp_path / 'out', DISPARITY)] == [60, 60, 50, 60]


def test_damage_half_way_keeps_what_is_done(run, tmp_path):
    bag = write(tmp_path / 'bag', stereo(400), compression='storage')
    file = bag / 'bag.mcap'
    data = bytearray(file.read_bytes())
    data[-1_300_000:-200_000] = bytes(1_100_000)
    file.write_bytes(data)
    told = run(bag, '--preset', 'fast', code=1)
    assert 'bag: damaged' in told and not (tmp_path / 'out').exists()
    done = messages_of(tmp_path / 'out.partial', DISPARITY)
    assert 50 < len(done) < 400
    assert f'out.partial: {len(done)} disparities' in told


def test_a_pair_that_does_not_fit_into_the_memory_ends_it_with_a_line_and_leaves_nothing(
        bag, run, tmp_path, monkeypatch):
    monkeypatch.setattr(memory, 'free_memory', lambda: 10**5)
    told = run(bag, code=2)
    assert 'out of memory: ' in told and '0.0 GB are free: set downscale, roi or fewer num_disparities' in told
    assert not list(tmp_path.glob('out*'))
    monkeypatch.undo()
    run(bag)


def test_memory_that_runs_out_half_way_keeps_what_is_done(bag, run, tmp_path, monkeypatch):
    run(bag, output='expected')
    compute, calls = StereoMatcher.compute, itertools.count()

    def fails_later(self, left, right, rows=None):
        if left.shape == (60, 90) and next(calls) == 3:
            raise MemoryError
        return compute(self, left, right, rows)

    with monkeypatch.context() as tight:
        tight.setattr(StereoMatcher, 'compute', fails_later)
        told = run(bag, code=1)
    assert 'out of memory: the memory is used up: set downscale' in told and 'out.partial: 3 disparities' in told
    run(bag)
    assert contents(tmp_path / 'out') == contents(tmp_path / 'expected')


def test_a_full_disk_keeps_what_is_done_and_the_next_run_goes_on(bag, run, tmp_path, monkeypatch):
    """No file may grow beyond 100 kB: an error of the system in the same place as that of a full disk."""
    monkeypatch.setattr(partial_bag, 'SEGMENT_BYTES', 40_000)
    run(bag, output='expected')
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (100_000, hard))
    try:
        told = run(bag, code=1)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert 'out.partial: cannot be written: File too large; make room, then the same command goes on' in told
    assert len(messages_of(tmp_path / 'out.partial', DISPARITY)) == 5
    assert 'out.partial: 5 disparities' in told
    with monkeypatch.context() as earlier:
        earlier.setattr(processing, '_FORMAT', 0)
        assert 'out.partial was begun with a different version of the output format' in run(bag, code=2)
    run(bag)
    assert contents(tmp_path / 'out') == contents(tmp_path / 'expected')


def test_memory_for_images_that_wait_is_bounded(run, tmp_path, monkeypatch):
    """With room for few images a partner that comes too late is not found; without a bound memory would grow."""
    monkeypatch.setattr(pair_stream, 'WAITING_BYTES', 20 * 90 * 60)
    lefts = [entry for entry in stereo(60) if entry[0] == LEFT]
    rights = [(topic, time_ns + 60 * PERIOD, message) for topic, time_ns, message in stereo(60) if topic == RIGHT]
    run(write(tmp_path / 'bag', lefts + rights))
    assert len(messages_of(tmp_path / 'out', DISPARITY)) == 19


# What belongs to a recording, in part


def test_a_torn_file_of_several_costs_its_own_pairs_only(run, tmp_path):
    folder = tmp_path / 'split'
    folder.mkdir()
    for number in range(2):
        bag = write(tmp_path / f'part{number}', list(stereo(6))[12 * number:12 * number + 12])
        (bag / f'part{number}.mcap').rename(folder / f'split_{number}.mcap')
    torn = folder / 'split_1.mcap'
    torn.write_bytes(torn.read_bytes()[:-2000])
    told = run(folder, code=1)
    assert 'out: 3 disparities of 3 pairs' in told
    assert f'left out: {torn}: the file is cut off' in told
    assert len(messages_of(tmp_path / 'out', DISPARITY)) == 3
    summary = json.loads((tmp_path / 'out' / 'summary.json').read_text())
    assert summary['complete'] and str(torn) in summary['recording'][0]


def test_a_part_without_images_says_where_they_lie(run, tmp_path):
    early = (LEFT_INFO, 0, camera_info('left', 0))
    bag = write(tmp_path / 'bag', [early, *stereo(3)])
    told = run(bag, '--start', '0.2', '--duration', '0.2', code=2)
    assert f'no pair among 0 images on {LEFT}' in told
    begin = re.search(r'they lie from 1700000000\.003 to 1700000000\.204 s .*: --start (1700000000\.00[23])',
                      told)
    run(bag, '--start', begin[1])
    assert len(messages_of(tmp_path / 'out', DISPARITY)) == 3


def test_a_calibration_that_changes_serves_the_images_of_its_time(run, tmp_path):
    """All left images come before all right ones, and so do the infos: each pair waits for long."""
    def focal(index):
        return 400.0 if index < 1500 else 500.0
    pixels = np.zeros((4, 8), np.uint8)
    chosen = [0, 700, 1499, 1500, 2900]
    entries = [(info, stamp(index), camera_info(side, stamp(index), (8, 4), focal(index))) for index in range(3000)
               for side, info in (('left', LEFT_INFO), ('right', RIGHT_INFO))]
    entries += [(LEFT, stamp(index) + MS, image(pixels, stamp(index))) for index in chosen]
    entries += [(RIGHT, stamp(4000 + index), image(pixels, stamp(index))) for index in chosen]
    run(write(tmp_path / 'bag', entries), '--set', 'w_p=3')
    assert [message.f for _, message in messages_of(tmp_path / 'out', DISPARITY)] == [400, 400, 400, 500, 500]


@pytest.mark.parametrize(('encoding', 'data', 'told'), [
    ('16UC1', np.zeros((60, 90), np.uint16), "the ground truth is no disparity: encoding '16UC1'"),
    ('32FC1', np.zeros((60, 45), np.float32), 'the ground truth is no disparity: 10800 bytes are no 90x60 px'),
])
def test_a_ground_truth_that_is_none_is_told(run, tmp_path, encoding, data, told):
    types = ROS2.types
    truth = image(data, stamp(0), encoding)
    truth.width = 90
    region = types['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False)
    message = types['stereo_msgs/msg/DisparityImage'](recordings.header(stamp(0)), truth, 1.0, 1.0, region, 0.0, 9.0,
                                                      1.0)
    bag = write(tmp_path / 'bag', [*stereo(2), ('/gt/disparity', stamp(0), message)])
    assert f'in 1 pairs: {told}' in run(bag)


def test_what_calls_itself_ground_truth_and_cannot_be_is_told(run, tmp_path):
    bag = write(tmp_path / 'bag', [*stereo(2), ('/gt/image', stamp(0), image(scene(0)[0], stamp(0)))])
    told = run(bag, '--left', LEFT, '--right', RIGHT)
    assert 'results are not judged by /gt/image, it is sensor_msgs/msg/Image' in told


# The command line


@pytest.mark.parametrize(('options', 'told'), [
    (('--set', 'foo=3'), "unknown parameter 'foo'"),
    (('--set', 'sigma_s=-1'), 'sigma_s = -1'),
    (('--set', 'alpha'), 'write it as name=value'),
    (('--preset', 'none'), "no preset 'none'"),
    (('--left', '/x', '--right', '/y'), 'no images on /x'),
    (('--calib', 'none.txt'), 'none.txt: there is no such file'),
])
def test_a_wrong_option_is_refused_before_anything_is_written(bag, run, tmp_path, options, told):
    assert told in run(bag, *options, code=2)
    assert list(tmp_path.iterdir()) == []


def test_an_output_that_exists_is_not_overwritten_without_force(bag, run, tmp_path):
    run(bag)
    before = contents(tmp_path / 'out')
    assert 'out exists already' in run(bag, '--set', 'alpha=3', code=2)
    assert contents(tmp_path / 'out') == before
    run(bag, '--set', 'alpha=3', '--force')
    assert contents(tmp_path / 'out') != before
    mine = tmp_path / 'mine'
    mine.mkdir()
    told = run(bag, '--force', output='mine', code=2)
    assert 'mine is no bag (no metadata.yaml in it), --force replaces bags only' in told
    assert 'name it without .mcap' in run(bag, output='out.mcap', code=2)


def test_a_parameter_file_of_the_node_is_taken_as_it_is(bag, run, tmp_path):
    file = tmp_path / 'node.yaml'
    file.write_text('/**:\n  ros__parameters:\n    use_sim_time: true\n    alpha: 3\n    publish_filled: false\n')
    run(bag, '--params', str(file))
    parameters = json.loads((tmp_path / 'out' / 'summary.json').read_text())['parameters']
    assert (parameters['alpha'], parameters['publish_filled']) == (3.0, False)


def test_it_runs_where_no_ros_is(bag, tmp_path):
    code = ('import sys\n'
            'class NoRos:\n'
            '    def find_spec(self, name, path=None, target=None):\n'
            '        if name.partition(".")[0] in ("rclpy", "sensor_msgs", "stereo_msgs", "std_msgs"):\n'
            '            raise ModuleNotFoundError(name)\n'
            'sys.meta_path.insert(0, NoRos())\n'
            'from svdm_ros.bags.process_bag import main\n'
            'sys.exit(main())')
    command = [sys.executable, '-c', code, str(bag), str(tmp_path / 'out'), *SMALL]
    done = subprocess.run(command, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stderr
    assert len(messages_of(tmp_path / 'out', DISPARITY)) == 5


@pytest.mark.parametrize('give_folder', [True, False])
def test_the_log_behind_a_symlink_is_part_of_what_the_output_depends_on(tmp_path, give_folder):
    (tmp_path / 'real').mkdir()
    (tmp_path / 'links').mkdir()
    link, log = tmp_path / 'links' / 'a.db3', tmp_path / 'real' / 'b.db3-wal'
    (tmp_path / 'real' / 'b.db3').write_bytes(b'')
    link.symlink_to(tmp_path / 'real' / 'b.db3')
    job = processing.Job(link.parent if give_folder else link, tmp_path / 'out')

    def recording():
        return processing._settings(job, StereoTopics(LEFT, RIGHT))['recording']

    assert [entry[:2] for entry in recording()] == [['a.db3', 0]]
    log.write_bytes(b'log')
    assert [entry[:2] for entry in recording()] == [['a.db3', 0], ['b.db3-wal', 3]]
