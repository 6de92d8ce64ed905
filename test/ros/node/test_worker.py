"""The worker's mailbox: newest job wins, but for a spare one; every drop is told, nothing kills the thread. And the
counts."""
import queue
import threading
import time
from collections import Counter

import pytest
from builtin_interfaces.msg import Time
from diagnostic_msgs.msg import DiagnosticStatus

from svdm_ros.node import worker
from svdm_ros.node.diagnostics import diagnostic_array
from svdm_ros.node.frame_statistics import FrameStatistics, PixelShares, Rate
from svdm_ros.node.worker import Worker

LIMIT = 10.0


class Bench:
    """A worker whose preparation and jobs wait until they are let go."""

    def __init__(self):
        self.prepare, self.gate = threading.Event(), threading.Semaphore(0)
        self.begun, self.errors, self.drops = queue.Queue(), queue.Queue(), Counter()
        self.worker = Worker(self._prepare, self._process, self._drop, self.errors.put)
        self.worker.start()

    def _prepare(self):
        assert self.prepare.wait(LIMIT)

    def _process(self, job):
        self.begun.put((job, threading.current_thread().name))
        assert self.gate.acquire(timeout=LIMIT)
        if job == 'bad':
            raise RuntimeError('bad job')

    def _drop(self, reason):
        self.drops[reason] += 1

    def make_ready(self):
        self.prepare.set()
        end = time.monotonic() + LIMIT
        while not self.worker.ready:
            assert time.monotonic() < end
            time.sleep(0.001)

    def next_begun(self):
        return self.begun.get(timeout=LIMIT)[0]


@pytest.fixture
def bench():
    bench = Bench()
    yield bench
    bench.prepare.set()
    bench.gate.release(100)
    assert bench.worker.stop(LIMIT)


def test_jobs_before_the_warm_up_are_dropped(bench):
    bench.worker.submit('early')
    bench.worker.submit('early')
    bench.make_ready()
    bench.worker.submit('first')
    assert bench.next_begun() == 'first'
    assert bench.drops == {'before warm-up': 2}


def test_the_newest_job_wins(bench):
    bench.make_ready()
    bench.worker.submit(0)
    assert bench.next_begun() == 0
    for job in range(1, 6):
        bench.worker.submit(job)
    bench.gate.release()
    assert bench.next_begun() == 5
    assert bench.drops == {'superseded': 4}


def test_a_moment_of_waiting_loses_nothing_and_a_longer_one_leaves_the_newest(bench, monkeypatch):
    bench.make_ready()
    bench.worker.submit(0)
    assert bench.next_begun() == 0
    bench.worker.submit(1)
    bench.worker.submit(2)
    bench.gate.release(2)
    assert [bench.next_begun(), bench.next_begun()] == [1, 2]
    assert not bench.drops
    bench.worker.submit(3)
    bench.worker.submit(4)  # the spare place is taken until a second has gone by
    assert bench.drops == {'superseded': 1}
    monkeypatch.setattr(worker, '_SPARE_EACH', 0.0)
    bench.worker.submit(5)
    bench.gate.release(2)
    assert [bench.next_begun(), bench.next_begun()] == [4, 5]
    assert bench.drops == {'superseded': 1}


def test_an_error_is_told_and_the_next_job_is_done(bench):
    bench.make_ready()
    bench.worker.submit('bad')
    assert bench.next_begun() == 'bad'
    bench.gate.release()
    assert str(bench.errors.get(timeout=LIMIT)) == 'bad job'
    bench.worker.submit('good')
    assert bench.next_begun() == 'good'


def test_all_jobs_run_in_the_workers_own_thread(bench):
    bench.make_ready()
    bench.worker.submit('job')
    assert bench.begun.get(timeout=LIMIT)[1] == 'matcher'


def test_stop_says_when_the_thread_is_still_busy(bench):
    bench.make_ready()
    bench.worker.submit('job')
    bench.next_begun()
    assert bench.worker.stop(0.01) is False


def test_the_counts_add_up():
    statistics = FrameStatistics()
    for side in ('left', 'right', 'left'):
        statistics.count_received(side)
    statistics.count_pair()
    statistics.count_drop('superseded')
    statistics.count_drop('superseded')
    statistics.set_dropped('unpaired left', 1)
    statistics.set_dropped('unpaired right', 0)
    statistics.count_published(0.025, {'total': 20.0}, PixelShares(0.8, 0.9))
    statistics.count_defect()
    counts = statistics.snapshot()
    assert counts.received == {'left': 2, 'right': 1}
    assert (counts.pairs, counts.published, counts.total_dropped, counts.defects) == (1, 1, 3, 1)
    assert counts.dropped_text() == '3 dropped (2 superseded, 1 unpaired left)'
    assert counts.latencies == (0.025,)


def test_the_rate_is_over_the_time_between_two_looks():
    rate = Rate(now=10.0)
    assert [rate.update(total, now) for total, now in ((6, 12.0), (6, 13.0), (7, 13.5), (9, 13.5))] == [3, 0, 2, 0]


def test_diagnostics_tell_counts_rate_latency_and_trouble():
    statistics = FrameStatistics()
    for milliseconds in range(1, 101):
        shares = PixelShares(0.8, 0.9 if milliseconds > 70 else 0.1)
        statistics.count_published(milliseconds / 1e3, {'total': 20.04}, shares)
    statistics.count_drop('unreadable')
    counts, stamp = statistics.snapshot(), Time(sec=3)
    message = diagnostic_array('/node', stamp, counts, 9.5, ready=True, more={'features': '45'})
    (status,) = message.status
    values = {pair.key: pair.value for pair in status.values}
    assert (message.header.stamp, status.name, status.level, status.message) == (
        stamp, '/node', DiagnosticStatus.OK, '9.5 Hz')
    assert (values['state'], values['features']) == ('ready', '45')
    assert (values['published'], values['dropped: unreadable'], values['total (ms)']) == ('100', '1', '20.0')
    assert (values['latency p50 (ms)'], values['latency p95 (ms)']) == ('51.0', '96.0')
    assert (values['valid pixels (%)'], values['confidence above confidence_threshold (%)']) == ('80', '90')
    troubled = diagnostic_array('/node', stamp, counts, 0.0, ready=True, trouble='no images').status[0]
    assert (troubled.level, troubled.message) == (DiagnosticStatus.WARN, 'no images')
    (compiling,) = diagnostic_array('/node', stamp, counts, 0.0, ready=False, trouble='no images').status
    assert next(pair.value for pair in compiling.values if pair.key == 'state') == 'compiling'
    assert diagnostic_array('/node', stamp, counts, 0.0, ready=False).status[0].message == 'compiling'
