"""Images that are missing by the stamps of those that came."""
import math
import random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from svdm_ros.node.stamp_rhythm import StampRhythm, missing_share, usual_gap

MS = 1_000_000
PERIOD = 33 * MS


def stamps(count, keep=1.0, period=PERIOD, jitter=0.0, seed=0, start=10**18):
    """Of `count` images of which a share comes, their stamps jittering by a share of the period."""
    chance = random.Random(seed)
    return [start + index * period + round(chance.uniform(-jitter, jitter) * period)
            for index in range(count) if chance.random() < keep]


def missing(*streams):
    rhythm = StampRhythm()
    found = []
    for stamp in (stamp for stream in streams for stamp in stream):
        rhythm.add(stamp)
        found.append(rhythm.missing)
    return found


@pytest.mark.parametrize('keep', [0.2, 0.45, 0.7])
@pytest.mark.parametrize('jitter', [0.0, 0.05])
def test_the_share_that_is_lost_is_found(keep, jitter):
    period, share = missing_share(sorted(stamps(400, keep, jitter=jitter)))
    assert period == pytest.approx(PERIOD, rel=0.05)
    assert share == pytest.approx(1 - keep, abs=0.08)


@given(st.integers(1, 2000), st.floats(0, 0.09), st.integers(0, 1000))
def test_nothing_is_missing_of_a_camera_that_sends_all(period_ms, jitter, seed):
    assert max(missing(stamps(200, period=period_ms * MS, jitter=jitter, seed=seed))) == 0


@pytest.mark.parametrize('streams', [
    [stamps(100), stamps(100, period=2 * PERIOD, start=10**18 + 101 * PERIOD)],
    [stamps(100), stamps(100, start=10**18 + 200 * PERIOD)],
    [stamps(100), stamps(100)],
    [stamps(100, start=2 * 10**18), stamps(100, start=10**18)],
    [stamps(10, start=10**18 + round(burst * 9.37 * 10**9)) for burst in range(20)],
    [stamps(1, start=10**18 + round(math.exp(shot / 3) * 10**9)) for shot in range(60)],
], ids=['another rate', 'a pause', 'a loop', 'back in time', 'bursts', 'slower and slower'])
def test_rates_pauses_and_jumps_are_no_loss(streams):
    assert max(missing(*streams)) < 0.1


def test_a_trigger_without_a_rhythm_is_no_loss():
    chance = random.Random(1)
    times, now = [], 10**18
    for _ in range(300):
        now += round(chance.expovariate(1 / PERIOD)) + MS
        times.append(now)
    assert max(missing(times)) == 0


def test_a_loss_that_ends_is_forgotten_after_a_window():
    found = missing(stamps(400, 0.5), stamps(100, start=10**18 + 400 * PERIOD))
    assert max(found) > 0.4 and found[-1] == 0


def test_how_far_stamps_of_left_and_right_are_apart():
    left = [index * PERIOD for index in range(20)]
    assert usual_gap(left, [stamp + 2 * MS for stamp in left], MS) == 2 * MS
    assert usual_gap(left, left, 0) == math.inf
    assert usual_gap(left, [], 0) == math.inf
