"""Pairs matched in the tuner's own process: the node's maps, anew with each change, at the recording's pace."""
import subprocess
import sys
import time

import numpy as np
import pytest
from checkout import CHECKOUT
from recordings import stereo, write
from scenes import two_walls
from tuner_process import wait_until
from tuning_scenes import write_pairs

from svdm_core import MatcherParameters, StereoMatcher
from svdm_core.evaluation.pair_folders import find_pairs
from svdm_ros.frames.frame_processing import FrameProcessor
from svdm_ros.node.parameter_set import NodeParameters
from svdm_ros.tuner import feeds
from svdm_ros.tuner.live_figures import flicker
from svdm_ros.tuner.local_source import FedPair, LocalSource
from svdm_ros.tuner.row_sources import SeenRows, StillRows

PARAMETERS = NodeParameters().replace({'num_disparities': 16})
LEFT, RIGHT, TRUTH = two_walls(60, 90, near=9, far=3, seed=1)


def still(left=LEFT, right=RIGHT, truth=None, **values):
    return LocalSource('a, b', lambda: feeds.still_pair(left, right, truth), PARAMETERS.replace(values), StillRows(),
                       plays=False)


def shot_after(source, number):
    return wait_until(lambda: (shot := source.latest()) is not None and shot.number > number and shot, 'a shot')


@pytest.fixture
def started():
    sources = []

    def start(source):
        sources.append(source)
        source.start()
        return source

    yield start
    for source in sources:
        source.stop()


@pytest.mark.parametrize(('left', 'right'), [
    (LEFT, RIGHT), tuple(image.astype(np.uint16) * 100 for image in (LEFT, RIGHT)),
    tuple(np.repeat(image[..., None], 3, 2) for image in (LEFT, RIGHT))])
def test_the_map_is_the_matchers(started, left, right):
    source = started(still(left, right, align_rows='off'))
    shot = shot_after(source, 0)
    expected = StereoMatcher(MatcherParameters(num_disparities=16)).compute(left, right)
    np.testing.assert_array_equal(shot.disparity, expected.disparity)
    np.testing.assert_array_equal(shot.confidence, expected.confidence)
    assert shot.trusted.sum() == (expected.confidence >= np.float32(0.2)).sum() and shot.known.all()
    assert shot.limits == (0, 15) and source.trouble() == ''


def test_a_change_is_seen_a_refusal_says_why_and_changes_nothing(started):
    source = started(still())
    first = shot_after(source, 0)
    assert source.change({'p2': 0.3, 'w_p': 5}) == ''
    second = shot_after(source, first.number)
    assert not np.array_equal(first.disparity, second.disparity) and not second.is_moving
    before = dict(source.values())
    assert source.change({'p2': 0.6, 'w_p': 4}).startswith('w_p = 4 is not allowed')
    assert dict(source.values()) == before and before['p2'] == 0.3
    time.sleep(0.3)
    assert source.latest() is second


def test_what_cannot_be_matched_is_told_and_the_next_change_is_heard(started):
    source = started(still())
    first = shot_after(source, 0)
    assert source.change({'roi': '0, 0, 5000, 5000'}) == ''
    wait_until(lambda: 'not within the image of 90x60 px' in source.trouble(), 'the trouble')
    assert source.latest() is first
    assert source.change({'roi': ''}) == ''
    assert shot_after(source, first.number).disparity.shape == (60, 90) and source.trouble() == ''


def test_whatever_goes_wrong_with_a_pair_is_told_and_the_thread_goes_on(started, monkeypatch):
    source = started(still())
    first = shot_after(source, 0)
    process = FrameProcessor.process
    monkeypatch.setattr(FrameProcessor, 'process', lambda *_: [][0])
    source.change({'p2': 0.5})
    wait_until(lambda: 'list index out of range' in source.trouble(), 'the trouble')
    monkeypatch.setattr(FrameProcessor, 'process', process)
    source.change({'p2': 0.6})
    shot_after(source, first.number)
    assert source.trouble() == ''


def test_where_the_feed_has_ended_nothing_pretends_to_go_on(started, monkeypatch):
    monkeypatch.setitem(sys.modules, 'skimage.data', None)
    source = started(LocalSource('demo', feeds.demo_pair, PARAMETERS, StillRows(), plays=False))
    wait_until(lambda: 'skimage' in source.trouble(), 'what is missing')
    assert source.change({'p2': 0.5}).startswith('nothing is matched any more: skimage')


def test_flicker_is_of_what_is_known():
    before, after = np.full((10, 10), np.nan, np.float32), np.full((10, 10), np.nan, np.float32)
    before[0], after[0] = 3, 3.5
    assert flicker(before, after) == 0.5 and flicker(before, before[:5]) is None
    assert flicker(np.full((2, 2), np.nan, np.float32), np.zeros((2, 2), np.float32)) is None


def test_figures_tell_of_time_validity_streaks_and_error(started):
    source = started(still(truth=TRUTH.astype(np.float32)))
    shot_after(source, 0)
    figures = wait_until(source.figures, 'figures')
    assert figures['time of a frame'].endswith(' ms') and figures['disparity_refinement'].endswith(' ms')
    assert {'valid pixels', 'trusted pixels', 'streaks', 'error'} <= set(figures)
    assert float(figures['error'].split()[0]) < 1
    assert 'rate' not in figures and not any('flicker' in name for name in figures)


def test_rows_are_aligned_as_the_parameter_says(started):
    shifted = np.roll(RIGHT, 1, axis=0)
    source = started(still(right=shifted))
    first = shot_after(source, 0)
    source.change({'align_rows': 'off'})
    off = shot_after(source, first.number)
    assert np.abs(off.disparity - TRUTH).mean() > 1.2 * np.abs(first.disparity - TRUTH).mean() or \
        np.array_equal(off.disparity, first.disparity)


def fed(count, gap):
    frame = next(feeds.still_pair(LEFT, RIGHT, None)).frame
    number = 0
    while True:
        yield FedPair(frame, None, gap * (number % count))
        number += 1


def test_it_plays_pauses_and_steps(started):
    source = started(LocalSource('bag', lambda: fed(1000, 0.05), PARAMETERS, SeenRows(), plays=True))
    first = shot_after(source, 2)
    assert first.is_moving and source.is_playing
    source.play(on=False)
    time.sleep(0.3)
    paused = source.latest().number
    time.sleep(0.4)
    assert source.latest().number == paused and not source.is_playing
    source.step()
    shot_after(source, paused)
    time.sleep(0.3)
    assert source.latest().number == paused + 1
    source.play(on=True)
    begun, number = time.monotonic(), source.latest().number
    shot_after(source, number + 9)
    assert time.monotonic() - begun > 0.35  # ten pairs, 0.05 s apart
    assert 'rate' in source.figures()


def test_a_recording_is_played_over_and_over(started, tmp_path):
    bag = write(tmp_path / 'bag', list(stereo(4)))
    source = started(LocalSource('bag', lambda: feeds.recorded(bag, (None, None), None), PARAMETERS, SeenRows(),
                                 plays=True))
    shot_after(source, 0)
    assert source.hold() is not None and source.trouble() == ''


def test_a_folder_is_played_over_and_over(started, tmp_path):
    folder = write_pairs(tmp_path / 'street', 2)
    source = started(LocalSource('street', lambda: feeds.folder_pairs(find_pairs([folder])), PARAMETERS, SeenRows(),
                                 plays=True))
    first = shot_after(source, 0)
    assert not np.array_equal(shot_after(source, first.number).left, first.left)
    shot_after(source, first.number + 2)


@pytest.mark.parametrize('feed', [
    lambda: feeds.recorded(CHECKOUT / 'README.md', (None, None), None),
    lambda: feeds.recorded(CHECKOUT / 'nothing.mcap', (None, None), None)])
def test_a_recording_that_is_none_is_told_on_the_page(started, feed):
    source = started(LocalSource('bag', feed, PARAMETERS, SeenRows(), plays=True))
    told = wait_until(lambda: 'being read' not in source.trouble() and source.trouble(), 'the trouble')
    assert '\n' not in told and source.latest() is None and source.hold() is None


def test_it_takes_no_ros():
    code = ('import sys\nimport svdm_ros.tuner.local_source, svdm_ros.tuner.feeds, svdm_ros.tuner.comparison\n'
            'import svdm_ros.tuner.tuning_session\n'
            'print({"rclpy", "sensor_msgs", "rosbags", "nicegui"} & set(sys.modules))')
    run = subprocess.run([sys.executable, '-c', code], cwd=CHECKOUT, capture_output=True, text=True, timeout=60)
    assert run.stdout == 'set()\n', run.stderr
