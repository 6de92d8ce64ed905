"""Recordings with bytes changed, cut or put in: read, or refused in one line; nothing else, and not for long.

With SVDM_FUZZ_EXAMPLES=2000 in the environment more of them are tried.
"""
import mmap
import os
import shutil
import time
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from recordings import ROS1, stereo, write, write_ros1

from svdm_ros.bags.reading.pair_stream import PairStream
from svdm_ros.bags.reading.recording import RecordingError, open_recording
from svdm_ros.bags.reading.stereo_topics import find_stereo_topics

TRIED = os.environ.get('SVDM_FUZZ_EXAMPLES')
EXAMPLES = int(TRIED or '30')
KINDS = ('mcap', 'mcap chunks', 'sqlite3', 'ros1')
LONGEST_S = 10
MOST_MEMORY = 2**30
"""Bytes beyond what the process has before; unpacking and reading of any few kB stay below."""
HEAD, TAIL = 300, 1500
"""Where most of what a reader goes by stands."""


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    """Small recordings of each kind, and room for damaged ones."""
    folder = tmp_path_factory.mktemp('whole')
    write(folder / 'mcap', stereo(2, pixels=tiny))
    write(folder / 'mcap chunks', stereo(2, pixels=tiny), compression='storage')
    write(folder / 'sqlite3', stereo(2, pixels=tiny), 'sqlite3')
    (folder / 'ros1').mkdir()
    write_ros1(folder / 'ros1' / 'a.bag', stereo(2, pixels=tiny, types=ROS1))
    return folder


def tiny(index):
    return np.full((4, 8), index, np.uint8), np.full((4, 8), index + 1, np.uint8)


@st.composite
def changes(draw):
    """Edits of a file: where, counted from its beginning or its end, and what is done there."""
    place = st.one_of(st.integers(0, HEAD), st.integers(-TAIL, -1), st.integers(0, 10**6))
    edits = st.one_of(
        st.tuples(st.just('flip'), place, st.integers(1, 255)), st.tuples(st.just('zeros'), place, st.integers(1, 64)),
        st.tuples(st.just('ones'), place, st.integers(1, 8)), st.tuples(st.just('cut'), place, st.integers(1, 400)))
    return draw(st.lists(edits, min_size=1, max_size=3))


def changed(data, edits):
    data = bytearray(data)
    for kind, place, value in edits:
        at = place % max(len(data), 1)
        if kind == 'flip' and data:
            data[at] ^= value
        elif kind == 'zeros':
            data[at:at] = bytes(value)
        elif kind == 'ones':
            data[at:at + value] = b'\xff' * value
        elif kind == 'cut':
            del data[at:at + value if value < 300 else None]
    return bytes(data)


def read_as_process_bag_does(path):
    """Every pair of it; RecordingError is all that may come."""
    with open_recording(path) as recording:
        topics = find_stereo_topics(recording.topics)
        for _ in PairStream(recording, topics, 0, copied=frozenset(topics.infos), start_ns=recording.start_ns,
                            stop_ns=recording.end_ns):
            pass


def damaged(bags, target, kind, edits, of_metadata):
    shutil.rmtree(target, ignore_errors=True)
    shutil.copytree(bags / kind, target)
    [file] = [path for path in target.iterdir() if (path.name == 'metadata.yaml') == of_metadata]
    file.write_bytes(changed(file.read_bytes(), edits))
    return file if kind == 'ros1' else target


def memory(name):
    """Bytes of this process now ('VmRSS'), or at its peak ('VmHWM')."""
    [line] = [line for line in Path('/proc/self/status').read_text().splitlines() if line.startswith(f'{name}:')]
    return int(line.split()[1]) * 1024


def forget_peak():
    """The peak is that of what comes from now on, whatever the process took before (proc(5), clear_refs)."""
    Path('/proc/self/clear_refs').write_text('5')


def test_memory_is_measured_whatever_was_taken_before():
    for size in (2**27, 2**25):
        forget_peak()
        before = memory('VmRSS')
        touched = np.frombuffer(mmap.mmap(-1, size), np.uint8)  # new pages: numpy may get what the process has kept
        touched[::mmap.PAGESIZE] = 1
        del touched
        assert 0.9 * size < memory('VmHWM') - before < 1.5 * size


@settings(max_examples=EXAMPLES, deadline=None, database=None, derandomize=not TRIED,
          suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow])
@given(kind=st.sampled_from(KINDS), edits=changes(), of_metadata=st.booleans())
def test_a_damaged_bag_is_read_or_refused_in_one_line(bags, tmp_path_factory, capfd, kind, edits, of_metadata):
    path = damaged(bags, bags.with_name('damaged'), kind, edits, of_metadata and kind != 'ros1')
    forget_peak()
    before, begin = memory('VmRSS'), time.monotonic()
    try:
        read_as_process_bag_does(path)
    except RecordingError as error:
        assert '\n' not in str(error) and len(str(error)) < 1000
    assert time.monotonic() - begin < LONGEST_S
    assert memory('VmHWM') - before < MOST_MEMORY
    assert capfd.readouterr() == ('', '')
