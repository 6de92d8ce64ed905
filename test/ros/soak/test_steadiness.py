"""What is judged of a steady run."""
import dataclasses
import subprocess
import sys

import pytest
from node_bench import CHECKOUT

from svdm_ros.soak.steadiness import steadiness
from svdm_ros.soak.tally import Minute, Tally


def run(growth=9.0, last=75.0, published=72_000, minutes=60):
    """growth: MB, in steps from minute to minute. last: ms, of the answers of the last ten minutes."""
    tally = Tally(pairs=72_000, published=published, dropped={'superseded': 72_000 - published})
    for number in range(minutes):
        size = round(200e6 + growth * 1e6 * number / max(minutes - 1, 1))
        tally.minutes.append(Minute(sent=1200, latencies=[last if number >= minutes - 10 else 50.0] * 100,
                                    rss=[size - 10**8, size, size + 10**8]))
        tally.samples += [(60.0 * number + second, size) for second in range(0, 60, 10)]
    tally.samples.append((60.0 * minutes, size))
    tally.minutes.append(Minute(sent=1, latencies=[1e6], rss=[10**12]))  # begun, and over at once
    return steadiness(tally)


def test_growth_is_from_the_first_whole_minute_to_the_last_and_latency_that_of_ten_minutes():
    found = run()
    assert (found.growth, found.lost, found.minutes) == (9.0, 0, 10)
    assert (found.p99_first, found.p99_last) == (50.0, 75.0) and found.faults == []
    assert [minute for minute, _ in found.rss] == [1, 11, 21, 31, 40, 50, 60]
    assert found.hourly == pytest.approx(9.0, abs=0.5)


@pytest.mark.parametrize(('change', 'fault'), [
    ({'growth': 10.1}, 'RSS grew'), ({'last': 75.1}, 'p99 of the last'), ({'published': 71_999}, 'pairs were lost'),
    ({'published': 0}, 'pairs were lost'),
])
def test_each_limit_is_a_fault_of_its_own(change, fault):
    found = run(**change)
    assert len(found.faults) == 1 and found.faults[0].startswith(fault)


def test_the_lines_tell_the_figures():
    rss, lost, p99 = run(published=71_998).lines()
    assert rss.startswith('RSS (MB): 200.0 in minute 1, ') and 'growth +9.0 (at most 10)' in rss
    assert 'lost: 2 of 72000 pairs' in lost and '2 superseded' in lost
    assert p99 == 'p99: 50.0 ms in the first 10 min, 75.0 in the last, 1.50 times (at most 1.5)'


def test_a_short_run_is_judged_by_a_third_and_an_empty_one_breaks_all_limits():
    assert run(minutes=6).minutes == 2 and run(minutes=1).minutes == 1
    assert len(steadiness(Tally()).faults) == 3
    assert dataclasses.replace(run(), published=0, pairs=0).faults


@pytest.mark.slow
def test_a_short_run_with_larger_pairs_loses_nothing():
    done = subprocess.run([sys.executable, '-m', 'svdm_ros.soak', '--steady', '--minutes', '0.05', '--size', '400x300',
                           '--rate', '5'], cwd=CHECKOUT, capture_output=True, text=True, timeout=100)
    assert done.returncode == 0, done.stdout + done.stderr
    assert '400x300 px, 5 pairs a second' in done.stdout and ', wrong 0 of ' in done.stdout
    assert 'lost: 0 of ' in done.stdout and 'p99: ' in done.stdout
