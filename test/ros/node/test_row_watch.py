"""The thread that measures rows: what it finds is what the frames are aligned by, and no frame waits for it."""
import math
import threading
import time

import numpy as np
import pytest
from node_bench import image_message
from row_scenes import HEIGHT, WIDTH, difference, pair
from scenes import noise
from sensor_msgs.msg import CameraInfo

from svdm_core import MatcherParameters, RowAlignment, StereoMatcher
from svdm_core.row_alignment.tracking import LOOKS
from svdm_ros.frames.frame_preparation import FramePreparation
from svdm_ros.frames.frame_processing import FrameProcessor
from svdm_ros.frames.views import StereoFrame
from svdm_ros.node.log_lines import LogLines
from svdm_ros.node.parameter_set import NodeParameters
from svdm_ros.node.row_watch import RowWatch

LIMIT = 20.0
FIELD = RowAlignment((0.3, 0, 0, 0.9, 0, 0), WIDTH, HEIGHT)
ALIGNED = RowAlignment.identity(WIDTH, HEIGHT)
PARAMETERS = NodeParameters(MatcherParameters(num_disparities=24, aggregation='box'))
FOCAL_LENGTH = 300.0


class Log(list):
    info = warning = error = list.append


def info(side, focal_length=FOCAL_LENGTH):
    p = [focal_length, 0, WIDTH / 2, -20.0 * (side == 'right'), 0, focal_length, HEIGHT / 2, 0, 0, 0, 1, 0]
    return CameraInfo(width=WIDTH, height=HEIGHT, p=[float(value) for value in p])


def with_distortion(camera_info, d):
    camera_info.d = d
    return camera_info


class Bench:
    """A watch at work, pairs a second apart, and what it says."""

    def __init__(self, mode='track'):
        self.lines, self.errors = Log(), []
        self.watch = RowWatch(LogLines(self.lines), self.errors.append)
        self.watch.start()
        self.parameters = PARAMETERS.replace({'align_rows': mode})
        self.now, self._preparation, self.info = 0.0, FramePreparation(), info

    def frame(self, left, right, focal_length=FOCAL_LENGTH):
        self.now += 1
        return StereoFrame(image_message(left), image_message(right), self.info('left', focal_length),
                           self.info('right', focal_length), self.now)

    def show(self, left, right, focal_length=FOCAL_LENGTH):
        """By what the rows of this pair are aligned, before it is measured; then wait until it is."""
        rows = self.watch(self._preparation.of(self.frame(left, right, focal_length), self.parameters))
        self.wait()
        return rows

    def wait(self):
        end = time.monotonic() + LIMIT
        while self.watch.is_busy:
            assert time.monotonic() < end
            time.sleep(0.002)

    def use(self, **values):
        self.parameters = self.parameters.replace(values)


@pytest.fixture
def bench():
    benches = []

    def make(*arguments):
        benches.append(Bench(*arguments))
        return benches[-1]
    yield make
    for made in benches:
        assert made.watch.stop(LIMIT)
        assert made.errors == []
    assert [thread for thread in threading.enumerate() if thread.name == 'rows'] == []


OFF = [pair('leaves', FIELD, seed) for seed in range(3)]
EVEN = [pair('leaves', ALIGNED, seed) for seed in range(3)]


def test_frames_are_aligned_by_what_pairs_before_have_shown(bench):
    made = bench()
    processor = FrameProcessor(rows=made.watch)
    for k in range(3):
        processor.process(made.frame(*OFF[k]), made.parameters)
        made.wait()
    rows = made.show(*OFF[0])
    assert difference(rows, FIELD) < 0.1
    done = processor.process(made.frame(*OFF[0]), made.parameters)
    expected = StereoMatcher(made.parameters.matcher).compute(*OFF[0], rows)
    assert done.frame.disparity.tobytes() == expected.disparity.tobytes()
    assert done.timings['row_alignment'] > 0
    plain = StereoMatcher(made.parameters.matcher).compute(*OFF[0])
    assert done.frame.disparity.tobytes() != plain.disparity.tobytes()


def test_it_is_told_once_and_in_the_diagnostics(bench):
    made = bench()
    assert made.watch.values() == {}
    for k in range(3):
        made.show(*OFF[k])
    [line] = made.lines
    assert line.startswith('rows aligned, offsets of the right image in px: centre +0.') and 'top left +' in line
    assert 'top right -' in line and 'points the rms goes from ' in line
    values = made.watch.values()
    assert values['row alignment'] == 'track' and int(values['row alignment points']) >= 60
    assert float(values['row alignment centre (px)']) == pytest.approx(0.3, abs=0.15)
    assert float(values['row alignment top right (px)']) == pytest.approx(-0.6, abs=0.25)
    before, after = (float(values[f'row alignment residual {when} (px)']) for when in ('before', 'after'))
    assert after < 0.15 < before
    assert abs(float(values['vertical offset (px)'])) < 0.15  # what is left


def test_once_is_kept_where_track_goes_on(bench):
    moved = RowAlignment((1.3, 0, 0, 0.9, 0, 0), WIDTH, HEIGHT)
    later = [pair('leaves', moved, seed) for seed in range(3)]
    found = {}
    for mode in ('once', 'track'):
        made = bench(mode)
        for k in range(LOOKS):
            made.show(*OFF[k % 3])
        first = made.show(*later[0])
        for k in range(2 * LOOKS):
            made.show(*later[k % 3])
        found[mode] = first, made.show(*later[0])
    assert found['once'][0] is found['once'][1] and difference(found['once'][1], FIELD) < 0.1
    assert difference(found['track'][1], moved) < 0.1


def test_once_ends_where_rows_have_come_to_be_aligned_meanwhile(bench):
    made = bench('once')
    while made.show(*OFF[0]) is None:
        assert made.now < LOOKS
    while made.show(*EVEN[int(made.now) % 3]) is not None:
        assert made.now < 2 * LOOKS
    for k in range(2 * LOOKS):
        made.show(*EVEN[k % 3])
    for k in range(2 * LOOKS):
        assert made.show(*OFF[k % 3]) is None


def test_numbers_of_a_calibration_that_are_none_do_not_begin_it_anew(bench):
    made = bench()
    made.info = lambda *arguments: with_distortion(info(*arguments), [math.nan] * 5)
    for k in range(3):
        made.show(*OFF[k])
    assert difference(made.show(*OFF[0]), FIELD) < 0.1


def test_off_aligns_nothing_but_rows_that_do_not_correspond_are_told(bench):
    made = bench('off')
    left, right = EVEN[0]
    for _ in range(12):
        assert made.show(left, np.roll(right, 5, axis=0)) is None
    assert 'features are 5.' in made.watch.line(made.now) and 'lower in the right image' in made.watch.line(made.now)
    assert made.watch.values()['row alignment'] == 'off' and made.lines == []


def test_what_is_measured_is_what_is_matched(bench):
    """Shrunk images have smaller offsets."""
    made = bench('off')
    made.use(downscale=2)
    left, right = EVEN[0]
    for _ in range(12):
        made.show(left, np.roll(right, 6, axis=0))
    assert float(made.watch.values()['vertical offset (px)']) == pytest.approx(3, abs=0.1)


def test_what_is_aligned_is_told_only_while_it_is(bench):
    made = bench()
    pairs = [pair('leaves', RowAlignment((1.4, 0, 0, 0.3, 0, 0), WIDTH, HEIGHT), seed) for seed in range(3)]
    for k in range(12):
        made.show(*pairs[k % 3])
    assert made.watch.line(made.now) == ''
    made.use(align_rows='off')
    for k in range(12):
        assert made.show(*pairs[k % 3]) is None
    assert 'rows do not correspond' in made.watch.line(made.now)


@pytest.mark.parametrize('change', [
    {'focal_length': 310.0}, {'num_disparities': 30}, {'roi': '0, 0, 250, 200'}, {'downscale': 2}])
def test_another_setting_drops_it_at_once(bench, change):
    made = bench()
    for k in range(3):
        made.show(*OFF[k])
    assert made.show(*OFF[0]) is not None
    focal_length = change.pop('focal_length', FOCAL_LENGTH)
    made.use(**change)
    assert made.show(*EVEN[0], focal_length) is None
    assert made.lines[1:] == ['the row alignment is dropped, and measured anew: camera_info, or the part, size or '
                              'search range of the images has changed']
    for k in range(3):
        assert made.show(*EVEN[k], focal_length) is None


def test_what_a_look_finds_of_an_earlier_setting_is_lost(bench):
    made = bench()
    first = made._preparation.of(made.frame(*OFF[0]), made.parameters)
    made.use(num_disparities=30)
    second = made._preparation.of(made.frame(*EVEN[0]), made.parameters)
    assert made.watch(first) is None  # being measured while the setting changes
    assert made.watch(second) is None
    made.wait()
    for k in range(3):
        assert made.show(*EVEN[k]) is None
    assert made.lines == []


@pytest.mark.parametrize('pairs', [
    [(EVEN[0][0],) * 2], [(EVEN[0][0], EVEN[1][1])], [(OFF[0][0], OFF[0][1][::-1])],
    [(OFF[0][0] // 64, OFF[0][1] // 64)], [(np.full((HEIGHT, WIDTH), 90, np.uint8),) * 2],
    [(noise(HEIGHT, WIDTH), noise(HEIGHT, WIDTH, seed=1))],
    [(OFF[0][0][:30, :40], OFF[0][1][:30, :40])], [(noise(1, 1),) * 2], EVEN,
], ids=['identical', 'other scenes', 'flipped', 'dark', 'constant', 'noise', 'few points', '1x1', 'aligned'])
def test_pairs_that_tell_nothing_change_nothing(bench, pairs):
    made = bench()
    for k in range(6):
        assert made.show(*pairs[k % len(pairs)]) is None
    assert made.lines == [] and made.watch.line(made.now) == ''
    assert all(math.isfinite(float(value)) for name, value in made.watch.values().items() if name != 'row alignment')


def test_exposures_that_differ_change_nothing(bench):
    made = bench()
    for k in range(3):
        made.show(OFF[k][0], (0.5 * OFF[k][1] + 60).astype(np.uint8))
    assert difference(made.show(*OFF[0]), FIELD) < 0.1


def test_no_frame_waits_and_no_failure_is_lost():
    told, go_on = [], threading.Event()

    def report(error):
        told.append(str(error))
        assert go_on.wait(LIMIT)

    made = Bench()
    made.watch = RowWatch(LogLines(made.lines), report)
    made.watch.start()
    prepared = made._preparation.of(made.frame(*OFF[0]), made.parameters)
    pair_of_sizes = prepared.pair._replace(right=prepared.pair.right[:-1])
    assert made.watch(prepared._replace(pair=pair_of_sizes)) is None
    end = time.monotonic() + LIMIT
    while not told:
        assert time.monotonic() < end
        time.sleep(0.002)
    for later in range(2, 9):  # the thread is at it still
        assert made.watch(prepared._replace(arrived=float(later))) is None
    go_on.set()
    made.wait()
    assert len(told) == 1 and 'must have the same size' in told[0]
    for k in range(3):
        made.now += 10
        made.show(*OFF[k])
    assert made.show(*OFF[0]) is not None
    assert made.watch.stop(LIMIT)
