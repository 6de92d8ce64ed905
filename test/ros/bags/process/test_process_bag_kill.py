"""kill -9 at any moment: what is there is a bag of whole messages, and the next run ends with the same bytes."""
import multiprocessing
import os
import queue
import random
import signal
import threading
import time
from collections import Counter

import processed_bag
import pytest
import yaml
from recordings import LEFT_INFO, RIGHT_INFO, contents, stereo, write
from scenes import two_walls

from svdm_ros.bags.process_bag import main

KILLS = 10
PAIRS = 60


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    """Pairs of 240x120 px: 115 kB a disparity, some twelve files on the way."""
    def pixels(index):
        return two_walls(120, 240, seed=2 * (index % 8))[:2]

    return write(tmp_path_factory.mktemp('kill') / 'bag', stereo(PAIRS, pixels=pixels))


@pytest.fixture(scope='module')
def start():
    """Starts process_bag in a process of its own, forked from one in which all is imported that takes time.

    Not a kernel: with the first one called come the threads of OpenMP, which survive no fork.
    """
    context = multiprocessing.get_context('forkserver')
    context.set_forkserver_preload(
        ['numba', 'cv2', 'rich.progress', 'rosbags.convert.converter', processed_bag.__name__])

    def started(bag, output):
        process = context.Process(target=processed_bag.process, args=(bag, output))
        process.start()
        return process
    return started


def test_after_ten_kills_the_bytes_are_those_of_an_uninterrupted_run(bag, start, tmp_path):
    chance = random.Random(5)
    whole = start(bag, tmp_path / 'whole')
    whole.join()
    assert whole.exitcode == 0
    expected = contents(tmp_path / 'whole')
    assert Counter(topic for topic, _, _ in expected) == {'/disparity': PAIRS, LEFT_INFO: PAIRS, RIGHT_INFO: PAIRS}

    kept = []
    output, partial = tmp_path / 'out', tmp_path / 'out.partial'
    for kill in range(KILLS):
        process = start(bag, output)
        # At any moment: twice of the start, then of the writing, and with the tenth still before the end.
        goal = PAIRS * (kill - 1) / KILLS
        end = time.monotonic() + 30
        while process.is_alive() and _disparities(partial) < goal and time.monotonic() < end:
            time.sleep(0.005)
        time.sleep(chance.uniform(0, 0.05 if kill > 1 else 0.5))
        os.kill(process.pid, signal.SIGKILL)
        process.join()
        assert process.exitcode == -signal.SIGKILL
        if partial.exists() and (partial / 'metadata.yaml').exists():
            found = contents(partial)
            assert len(set(found)) == len(found) and set(found) <= set(expected)
            kept.append(sum(topic == '/disparity' for topic, _, _ in found))
    assert kept == sorted(kept), 'what was done once is never lost'
    assert kept[-1] > kept[0] and len(set(kept)) > 3

    last = start(bag, output)
    last.join()
    assert last.exitcode == 0
    assert contents(output) == expected
    assert not partial.exists()
    told = (tmp_path / 'out.log').read_text()
    assert f'\n  {PAIRS - kept[-1]} matched' in told, 'nothing is matched twice'


def _disparities(partial):
    """How many are safe, from the metadata alone; the files may go while they are looked at."""
    try:
        metadata = yaml.safe_load((partial / 'metadata.yaml').read_text())['rosbag2_bagfile_information']
    except FileNotFoundError:
        return 0
    topics = metadata['topics_with_message_count']
    counts = {entry['topic_metadata']['name']: entry['message_count'] for entry in topics}
    return counts.get('/disparity', 0)


@pytest.mark.parametrize('number', [signal.SIGINT, signal.SIGTERM])
def test_a_signal_ends_it_with_a_line_and_loses_no_pair_that_is_done(bag, start, tmp_path, number):
    output, partial = tmp_path / 'out', tmp_path / 'out.partial'
    process = start(bag, output)
    end = time.monotonic() + 30
    while process.is_alive() and _disparities(partial) < 10 and time.monotonic() < end:
        time.sleep(0.005)
    os.kill(process.pid, number)
    process.join(20)
    assert process.exitcode == 130
    told = (tmp_path / 'out.log').read_text()
    assert 'interrupted; what is done is kept, the same command goes on from there' in told
    assert 10 <= sum(topic == '/disparity' for topic, _, _ in contents(partial)) < PAIRS


@pytest.mark.timeout(30)
def test_a_signal_within_a_queue_ends_it_all_the_same(bag, tmp_path, monkeypatch, capsys):
    """An exception there, between the waking of the other thread and the note of it, would have that wait for ever."""
    came = []

    class Interrupted(threading.Condition):
        def notify(self, n=1):
            if not came and self._waiters and threading.current_thread() is threading.main_thread():
                came.append(True)
                self._waiters[0].release()
                signal.raise_signal(signal.SIGINT)
                self._waiters.popleft()
            else:
                super().notify(n)

    class Queue(queue.Queue):
        def __init__(self, size):
            super().__init__(size)
            self.not_empty = Interrupted(self.mutex)

    monkeypatch.setattr('svdm_ros.bags.process.threads.queue.Queue', Queue)
    assert main([str(bag), str(tmp_path / 'out'), '--set', 'num_disparities=16']) == 130
    assert came
    assert 'interrupted; what is done is kept' in capsys.readouterr().err
    assert sum(topic == '/disparity' for topic, _, _ in contents(tmp_path / 'out.partial')) < PAIRS
