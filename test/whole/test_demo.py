"""The demo: its pure parts, and the real thing with few frames."""
import contextlib
import dataclasses
import json
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import ClassVar

import matplotlib.image
import numpy as np
import psutil
import pytest
from checkout import CHECKOUT

from svdm_core.presets import preset_folder
from svdm_ros.calibration.geometry import stereo_geometry
from svdm_ros.demo import output_folder, summary
from svdm_ros.demo import run as demo_run
from svdm_ros.demo.depth_picture import turned_view
from svdm_ros.demo.depth_view import Space
from svdm_ros.frames.image_conversion import image_to_array
from svdm_ros.processes import dds_profile
from svdm_ros.processes.camera import camera_info_message, image_message
from svdm_ros.processes.children import Child, RunError
from svdm_ros.processes.scene import MOTORCYCLE, NUM_DISPARITIES, load_scene

FRAMES = 5


@pytest.fixture(scope='module')
def scene():
    return load_scene()


# The scene


def test_ground_truth_points_from_the_left_image_to_the_right(scene):
    known = np.isfinite(scene.ground_truth)
    rows, columns = np.nonzero(known & (scene.ground_truth <= np.arange(scene.ground_truth.shape[1])))
    partners = columns - np.rint(scene.ground_truth[rows, columns]).astype(int)
    left = scene.left[rows, columns].astype(int)
    assert np.median(np.abs(left - scene.right[rows, partners])) < 8
    assert np.median(np.abs(left - scene.right[rows, columns])) > 16


def test_scene_fits_the_search_range(scene):
    known = scene.ground_truth[np.isfinite(scene.ground_truth)]
    assert scene.left.shape == scene.right.shape == (*scene.ground_truth.shape, 3) == (500, 741, 3)
    assert 0 < known.min() < known.max() < NUM_DISPARITIES - 1


def test_images_are_in_the_order_blue_green_red(scene):
    blue, _, red = scene.left[220:235, 330:350].reshape(-1, 3).mean(axis=0)  # the tank
    assert red > 2 * blue


def test_node_reads_the_calibration_as_middlebury_gives_it():
    infos = [camera_info_message(side, 500, 741) for side in ('left', 'right')]
    geometry = stereo_geometry(*infos, 741, 500)
    assert geometry.problem == ''
    assert geometry.focal_length == pytest.approx(994.978)
    assert geometry.baseline == pytest.approx(0.193001)
    assert geometry.principal_offset == pytest.approx(-31.086)


def test_camera_info_is_consistent():
    left, right = (camera_info_message(side, 500, 741) for side in ('left', 'right'))
    for info in (left, right):
        assert list(info.k) == [info.p[i] for i in (0, 1, 2, 4, 5, 6, 8, 9, 10)]
        assert (info.width, info.height, info.distortion_model, list(info.d)) == (741, 500, 'plumb_bob', [0.0] * 5)
    assert left.p[3] == 0
    assert right.p[3] == pytest.approx(-994.978 * 0.193001)
    assert (left.p[6], right.p[6]) == (254.877, 254.877)


def test_image_message_carries_the_pixels(scene):
    message = image_message(scene.left)
    assert message.header.frame_id == camera_info_message('left', 500, 741).header.frame_id
    np.testing.assert_array_equal(image_to_array(message), scene.left)


# The figures


@dataclasses.dataclass
class Received:
    received: int
    latency: float


def test_published_disparity_becomes_ground_truths_offset(scene):
    published = scene.ground_truth - np.float32(MOTORCYCLE.principal_offset)
    metrics = summary.quality(summary.pixel_offset(published, MOTORCYCLE.principal_offset), scene.ground_truth)
    assert metrics == {'avgerr': 0.0, 'bad1': 0.0, 'bad2': 0.0, 'bad4': 0.0, 'density': 100.0}


def test_quality_counts_an_invalid_pixel_as_bad_and_not_into_the_mean():
    truth = np.array([[10, 10, 10, 10, np.inf]], np.float32)
    offset = np.array([[10, 11.5, np.nan, 15, 99]], np.float32)
    assert summary.quality(offset, truth) == {
        'avgerr': 2.167, 'bad1': 75.0, 'bad2': 50.0, 'bad4': 50.0, 'density': 75.0}


def test_speed_is_of_the_receipt():
    frames = [Received(received=index * 250_000_000, latency=100.0 + index) for index in range(21)]
    assert summary.speed(frames) == {'fps': 4.0, 'latency_ms': {'p50': 110.0, 'p95': 119.0}}


def test_speed_of_a_single_frame_has_no_rate():
    assert summary.speed([Received(5, 80.0)]) == {'fps': None, 'latency_ms': {'p50': 80.0, 'p95': 80.0}}


@pytest.mark.parametrize(('received', 'superseded', 'lost'), [(40, 60, 0), (39, 60, 1), (0, 0, 100)])
def test_what_nobody_accounts_for_is_lost(received, superseded, lost):
    assert summary.Traffic(100, received, superseded).as_dict() == {
        'frames_sent': 100, 'frames_received': received, 'frames_superseded': superseded, 'frames_lost': lost}


def test_changed_lists_old_and_new():
    assert summary.changed({'alpha': 1.0, 'w_p': 11}, {'alpha': 10.7, 'w_p': 11}) == {'alpha': [1.0, 10.7]}


def test_the_turned_view_shows_the_nearest_points_and_looks_round_them():
    column, far = np.float32([[0, 0, 2.0], [0, 0, 2.5], [0, 0, 9]]), 5.0
    space = Space(np.zeros((1, 1), np.float32), column, np.uint8([[255, 0, 0], [0, 255, 0], [0, 0, 255]]))
    picture = turned_view(space, far, (100, 600))
    red, green, blue = ((picture == colour).all(axis=2) for colour in ((255, 0, 0), (0, 255, 0), (0, 0, 255)))
    assert red.sum() == green.sum() == 9 and not blue.any()  # what is farther than far is left out
    assert np.nonzero(red)[1].mean() > np.nonzero(green)[1].mean() + 20  # from the left, the near one is to the right
    in_line = Space(space.depth, np.repeat(column[:1], 3, axis=0), space.colours)
    assert (turned_view(in_line, far, (100, 100)) > 200).any(axis=2).sum() == 9


# Files and processes


def test_output_folder_takes_its_own_files_only(tmp_path):
    own = output_folder.prepare_output_folder(tmp_path / 'new')
    (own / 'summary.json').write_text('old')
    (own / 'note.txt').write_text("the user's")
    assert output_folder.prepare_output_folder(own) == own
    assert not (own / 'summary.json').exists()
    assert (own / 'note.txt').read_text() == "the user's"


def test_output_folder_leaves_foreign_files_alone(tmp_path):
    (tmp_path / 'summary.json').write_text('not yours')
    with pytest.raises(RunError, match='choose another folder'):
        output_folder.prepare_output_folder(tmp_path)
    with pytest.raises(RunError, match='is a file'):
        output_folder.prepare_output_folder(tmp_path / 'summary.json')
    assert (tmp_path / 'summary.json').read_text() == 'not yours'


@pytest.mark.parametrize(('free', 'expected'), [(1 << 40, 32 << 20), (64 << 20, 16 << 20), (0, 4 << 20)])
def test_shared_memory_segments_leave_room(free, expected):
    assert dds_profile.segment_bytes(free) == expected


def test_profile_has_the_segment_that_fits(tmp_path, monkeypatch):
    monkeypatch.setattr(dds_profile, 'segment_bytes', lambda free: 12345)
    text = dds_profile.write_profile(preset_folder() / 'fastdds.xml', tmp_path / 'profile.xml').read_text()
    assert '<segment_size>12345</segment_size>' in text


def test_dead_child_is_told_with_its_last_words(tmp_path):
    child = Child('node', tmp_path / 'node.log', 'svdm_ros.no_such_module')
    end = time.monotonic() + 20
    with pytest.raises(RunError, match=r'the node ended with exit code 1; its log .*\n.*No module named'):
        while time.monotonic() < end:
            child.check()
            time.sleep(0.05)
    with pytest.raises(RunError, match=r'the node ended with exit code 1'):
        child.is_done()



# The real thing


def _demo(*arguments: str) -> list[str]:
    return [sys.executable, '-m', 'svdm_ros.demo', *arguments]


def _children(pid: int) -> list[int]:
    return [int(child) for child in Path(f'/proc/{pid}/task/{pid}/children').read_text().split()]


def test_demo_end_to_end(tmp_path):
    output = tmp_path / 'out'
    run = subprocess.run(_demo('--frames', str(FRAMES), '--output', str(output)), cwd=CHECKOUT,
                         capture_output=True, text=True, timeout=110)
    assert run.returncode == 0, run.stdout + run.stderr
    assert 'off by more than 2 px' in run.stdout
    result = json.loads((output / 'summary.json').read_text())

    assert result['frames_received'] >= 2 * FRAMES
    assert result['frames_lost'] == 0
    assert result['frames_sent'] == result['frames_received'] + result['frames_superseded']
    assert 0 < result['latency_ms']['p50'] <= result['latency_ms']['p95']
    assert result['fps'] > 0
    assert result['changed'] == {'alpha': [1.0, 10.7], 'sigma_s': [1.0, 15.8], 'sigma_c': [0.1, 0.175], 'w_p': [11, 31]}
    for phase in (result['before'], result['after'], result['default']):
        assert phase['frames'] == FRAMES
        assert phase['distinct'] == 1, 'the same input must give the same output, to the bit'
        assert phase['density'] == 100
        assert 0 < phase['bad4'] < phase['bad2'] < phase['bad1'] < 100
    assert result['after']['avgerr'] <= 0.75 * result['before']['avgerr']
    assert result['after']['avgerr'] <= 1.45

    height, width, _ = matplotlib.image.imread(output / 'comparison.png').shape
    assert (height, width) > (800, 1600)
    assert result['default']['avgerr'] <= 0.95
    depth = matplotlib.image.imread(output / 'depth.png')
    assert depth.shape[:2] > (800, 1600) and depth[..., :3].std() > 0.1
    log = (output / 'node.log').read_text()
    assert 'ready: ' in log and '[WARN]' not in log and '[ERROR]' not in log


def _runs(pid):
    """Whether it does; what has ended may wait for somebody to take note of it."""
    try:
        return psutil.Process(pid).status() != psutil.STATUS_ZOMBIE
    except psutil.NoSuchProcess:
        return False


def test_demo_interrupted_leaves_no_process(tmp_path):
    demo = subprocess.Popen(_demo('--output', str(tmp_path / 'out')), cwd=CHECKOUT,
                            stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)
    try:
        end = time.monotonic() + 30
        while not (children := _children(demo.pid)):
            assert demo.poll() is None and time.monotonic() < end
            time.sleep(0.05)
        demo.send_signal(signal.SIGINT)
        _, errors = demo.communicate(timeout=30)
    finally:
        demo.kill()
    assert demo.returncode == 130
    assert errors.splitlines()[-1] == 'demo: interrupted, all processes ended'
    assert not any(map(_runs, children))


class InterruptedAtStart(Child):
    """Ctrl-C in the moment in which the process is there, and nobody knows of it yet."""

    started: ClassVar = []

    def __init__(self, *arguments):
        super().__init__(*arguments)
        self.started.append(self.pid)
        signal.raise_signal(signal.SIGINT)


def test_a_child_is_stopped_whenever_the_signal_comes(tmp_path, monkeypatch):
    monkeypatch.setattr(demo_run, 'Child', InterruptedAtStart)
    with pytest.raises(KeyboardInterrupt), contextlib.ExitStack() as stack:
        demo_run._started(stack, 'server', tmp_path / 'log', 'http.server', '0')
    assert len(InterruptedAtStart.started) == 1 and not _runs(InterruptedAtStart.started[0])


def test_demo_refuses_a_foreign_folder_in_one_line(tmp_path):
    (tmp_path / 'thesis.tex').touch()
    run = subprocess.run(_demo('--output', str(tmp_path)), cwd=CHECKOUT, capture_output=True, text=True, timeout=60)
    assert run.returncode == 1
    assert run.stderr.count('\n') == 1 and str(tmp_path) in run.stderr
