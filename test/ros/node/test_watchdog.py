"""The lines that tell what is missing."""
import dataclasses

import pytest

from svdm_ros.node.watchdog import Traffic, Watchdog

IDLE = Traffic(left=0, right=0, pairs=0, left_publishers=0, right_publishers=0, closest_gap_ns=None, tolerance_ns=0)


def run(*states, seconds=20):
    """The kinds of line told at each second, the traffic being what `states(second)` gives."""
    watchdog = Watchdog('/l', '/r', now=0.0)
    return [watchdog.check(float(second), states[0](second)) for second in range(1, seconds + 1)]


def traffic(second, left=0, right=0, pairs=0, **fields):
    return dataclasses.replace(IDLE, left=left * second, right=right * second, pairs=pairs * second, **fields)


def kinds(lines):
    return [line.kind if line else None for line in lines]


def test_all_is_well():
    assert run(lambda second: traffic(second, 10, 10, 10)) == [None] * 20


def test_nobody_publishes():
    lines = run(lambda second: traffic(second))
    assert kinds(lines) == [None] * 4 + ['nothing'] * 16
    assert 'nobody publishes on /l and /r' in lines[-1].text
    assert '-r left/image_rect:=' in lines[-1].text


def test_publishers_that_send_nothing():
    text = run(lambda second: traffic(second, left_publishers=1, right_publishers=2))[-1].text
    assert '/l (1 publisher)' in text
    assert '/r (2 publishers)' in text


@pytest.mark.parametrize(('left', 'right', 'there', 'missing'), [(0, 9, '/r', '/l'), (9, 0, '/l', '/r')])
def test_one_side_only(left, right, there, missing):
    lines = run(lambda second: traffic(second, left, right))
    assert kinds(lines) == [None] * 5 + ['one side'] * 15
    assert f'images on {there} but none for 5 s on {missing} (0 publishers)' in lines[-1].text
    assert f'-r {"left" if missing == "/l" else "right"}/image_rect:=' in lines[-1].text


@pytest.mark.parametrize(('gap', 'told'), [
    (5_000_000, 'at least 0.005000 s apart, approximate_sync_tolerance is 0.001 s: '),
    (5_000_000, 'set approximate_sync_tolerance to 0.0075'),
    (33_333_333, 'set approximate_sync_tolerance to 0.05'),
    (3_000_000_000, 'synchronise the clocks'),
    (None, 'do not advance together'),
    (0, 'do not advance together'),
])
def test_stamps_apart(gap, told):
    lines = run(lambda second: traffic(second, 9, 9, closest_gap_ns=gap, tolerance_ns=1_000_000))
    assert kinds(lines) == [None] * 5 + ['apart'] * 15
    assert told in lines[-1].text


def test_it_starts_again_when_the_images_stop_and_is_quiet_when_they_come_back():
    lines = run(lambda second: traffic(second if second < 5 else 5 if second < 15 else second, 10, 10, 10))
    assert kinds(lines) == [None] * 9 + ['nothing'] * 5 + [None] * 6


@pytest.mark.parametrize('pause', [0, 8])
def test_cameras_that_start_one_after_the_other_are_not_complained_of(pause):
    def late(second):
        left, right = max(0, second - pause), max(0, second - pause - 3)
        return dataclasses.replace(IDLE, left=left, right=right, pairs=right)

    silence = [None] * 4 + ['nothing'] * (pause - 4) if pause else []
    assert kinds(run(late)) == silence + [None] * (20 - pause)
