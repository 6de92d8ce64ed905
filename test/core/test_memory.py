import subprocess
import sys
import tracemalloc
from pathlib import Path

import numpy as np
import pytest
from checkout import CHECKOUT
from scenes import noise

from svdm_core import NotEnoughMemoryError, RowAlignment, StereoMatcher, load_preset, memory
from svdm_core.memory import needed_bytes
from svdm_core.runtime import free_memory as free_memory_module
from svdm_core.runtime.free_memory import RecentFreeMemory, free_memory


@pytest.mark.parametrize('preset', ['fast', 'default', 'accurate', 'paper'])
@pytest.mark.parametrize('shape', [(240, 320), (240, 320, 3)])
def test_what_a_pair_takes_is_known_before(preset, shape):
    left, right = noise(*shape), noise(*shape, seed=1)
    matcher = StereoMatcher(load_preset(preset), 2)
    StereoMatcher(matcher.parameters, 2).compute(left[:6], right[:6])  # what compiling takes does not count
    tracemalloc.start()
    try:
        matcher.compute(left, right)
        taken = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    assert 0.95 * taken <= needed_bytes(shape, matcher.parameters, 2) <= 2.0 * taken


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
@pytest.mark.parametrize('shape', [(480, 640), (480, 640, 3)])
def test_what_an_alignment_takes_is_known_before(shape, dtype):
    right, rows = noise(*shape, dtype=dtype), RowAlignment((0.5, 0.1, 0.1, 0.1, 0.1, 0.1), 640, 480)
    parameters = load_preset('fast')
    tracemalloc.start()
    try:
        kept = rows.apply(right)
        taken = tracemalloc.get_traced_memory()[1]
    finally:
        tracemalloc.stop()
    known = needed_bytes(shape, parameters, 1, is_aligned=True) - needed_bytes(shape, parameters, 1)
    assert kept.shape == shape and 0.95 * taken <= known <= 2.0 * taken


def test_a_pair_that_does_not_fit_is_refused_before_anything_is_allocated(monkeypatch):
    left = np.zeros((1536, 2048), np.uint8)
    matcher = StereoMatcher(load_preset('paper').replace(num_disparities=1024), 2)
    monkeypatch.setattr(memory, 'free_memory', lambda: 5 * 10**8)
    tracemalloc.start()
    try:
        with pytest.raises(NotEnoughMemoryError, match=r'2048x1536 px with 1024 disparities need about \d\.\d GB, and '
                                                       r'0\.5 GB are free$'):
            matcher.compute(left, left, RowAlignment((0.5, 0, 0, 0, 0, 0), 2048, 1536))
        assert tracemalloc.get_traced_memory()[1] < 10**6
    finally:
        tracemalloc.stop()
    small = noise(20, 30)
    assert matcher.compute(small, small).disparity.shape == (20, 30), 'the matcher goes on with what fits'


def test_what_the_last_pair_took_counts_as_free(monkeypatch):
    matcher = StereoMatcher(load_preset('fast'), 1)
    small, large = noise(200, 300), noise(210, 300)
    matcher.compute(small, small)
    missing = needed_bytes(large.shape, matcher.parameters, 1) - needed_bytes(small.shape, matcher.parameters, 1)
    monkeypatch.setattr(memory, 'free_memory', lambda: missing + 1)
    matcher.compute(large, large)
    monkeypatch.setattr(memory, 'free_memory', lambda: 0)
    matcher.compute(large, large)  # its buffers are there


def test_free_memory_is_that_of_the_machine_or_less():
    lines = Path('/proc/meminfo').read_text().splitlines()
    total = next(int(line.split()[1]) * 1024 for line in lines if line.startswith('MemTotal:'))
    assert 0 < free_memory() <= total


def test_free_memory_asked_for_again_and_again_is_read_once_a_second(monkeypatch):
    read = []
    monkeypatch.setattr(free_memory_module, 'free_memory', lambda: read.append(1) or len(read))
    now = [5.0]
    monkeypatch.setattr(free_memory_module.time, 'monotonic', lambda: now[0])
    recent = RecentFreeMemory()
    assert [recent() for _ in range(100)] == [1] * 100
    now[0] += 1.1
    assert (recent(), recent()) == (2, 2)


def test_a_limit_of_the_process_counts():
    """ulimit -v, of which the process has used a part."""
    code = ('import resource; resource.setrlimit(resource.RLIMIT_AS, (3 * 10**8, resource.RLIM_INFINITY)); '
            'from svdm_core.runtime.free_memory import free_memory; print(free_memory())')
    run = subprocess.run([sys.executable, '-c', code], cwd=CHECKOUT, check=True, capture_output=True, text=True)
    assert 10**7 < int(run.stdout) < 3 * 10**8


def test_svdm_match_says_what_is_needed_and_what_to_do(tmp_path, capsys, monkeypatch):
    from skimage.io import imsave

    from svdm_core.commands import cli
    imsave(tmp_path / 'a.png', noise(60, 80), check_contrast=False)
    monkeypatch.setattr(memory, 'free_memory', lambda: 10**5)
    assert cli.main(['match', str(tmp_path / 'a.png'), str(tmp_path / 'a.png'), '-o', str(tmp_path / 'd.pfm')]) == 2
    told = capsys.readouterr().err
    assert told.count('\n') == 1 and 'svdm match: out of memory: 80x60 px with 64 disparities need about 0.0 GB' in told
    assert told.endswith('take smaller images or fewer num_disparities\n') and not (tmp_path / 'd.pfm').exists()


@pytest.mark.parametrize(('cached', 'free'), [(0, 100), (300, 400)])
def test_files_that_a_container_has_read_give_way(tmp_path, monkeypatch, cached, free):
    """cgroup v1 and v2: the usage counts them."""
    (tmp_path / 'memory').mkdir()
    (tmp_path / 'memory' / 'memory.limit_in_bytes').write_text('1000\n')
    (tmp_path / 'memory' / 'memory.usage_in_bytes').write_text('900\n')
    (tmp_path / 'memory' / 'memory.stat').write_text(f'cache 800\ntotal_inactive_file {cached}\n')
    monkeypatch.setattr(free_memory_module, '_GROUPS', tmp_path)
    assert free_memory() == free
    (tmp_path / 'memory.max').write_text('700\n')
    (tmp_path / 'memory.current').write_text('650\n')
    (tmp_path / 'memory.stat').write_text('anon 650\ninactive_file 0\n')
    assert free_memory() == 50
    (tmp_path / 'memory.max').write_text('max\n')
    assert free_memory() == free


def test_buffers_of_another_route_are_given_back():
    left = noise(120, 160)
    matcher = StereoMatcher(load_preset('paper'), 1)
    matcher.compute(left, left)
    matcher.parameters = load_preset('fast')
    matcher.compute(left, left)
    alone = StereoMatcher(load_preset('fast'), 1)
    alone.compute(left, left)
    assert matcher._kept.keys() == alone._kept.keys()
