"""What is damaged, planted or not to be written does no harm: kernels are compiled, and one line says why."""
import os
import pickle
import resource
from pathlib import Path

import pytest

from svdm_core.kernels import cache, cache_files
from svdm_core.kernels.compilation import kernel

INDEX, DATA = '*.nbi', '*.nbc'
DAMAGE = {
    'empty': lambda content: b'',
    'one byte': lambda content: content[:1],
    'truncated': lambda content: content[:len(content) // 2],
    'one bit': lambda content: content[:-100] + bytes([content[-100] ^ 1]) + content[-99:],
    'random bytes': lambda content: bytes(range(256)) * (len(content) // 256 + 1),
    'zeros': lambda content: bytes(len(content)),
}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """The folder of the kernels of a test."""
    place = tmp_path / 'svdm_kernels_test'
    place.mkdir(mode=0o700)
    monkeypatch.setattr(cache_files, 'cache_folder', lambda: place)
    monkeypatch.setattr(cache_files, '_told', set())
    return place


def doubled():
    """A kernel as a new process has it: (cache hits, result)."""
    def twice(x):
        return 2 * x

    compiled = kernel(twice)
    return compiled(3), sum(compiled.stats.cache_hits.values())


@pytest.mark.parametrize('kind', [INDEX, DATA])
def test_damaged_files_are_replaced_and_told_in_one_line(folder, caplog, kind):
    assert doubled() == (6, 0)
    assert doubled() == (6, 1)
    for damage in DAMAGE.values():
        [file] = folder.rglob(kind)
        file.write_bytes(damage(file.read_bytes()))
        caplog.clear()
        cache_files._told.clear()
        assert doubled() == (6, 0)
        [line] = caplog.messages
        assert 'are damaged' in line and file.name in line and 'compiled anew' in line
        assert doubled() == (6, 1)


class Planted:
    def __init__(self, proof):
        self.proof = proof

    def __reduce__(self):
        return Path.touch, (self.proof,)


def plain(file, content):
    file.write_bytes(content)


def with_digest(file, content):
    cache_files._write(str(file), content)
    file.chmod(0o666)


def by_symlink(file, content):
    cache_files._write(str(file.with_suffix('.elsewhere')), content)
    file.symlink_to(file.with_suffix('.elsewhere'))


@pytest.mark.parametrize('plant', [plain, with_digest, by_symlink])
@pytest.mark.parametrize('kind', [INDEX, DATA])
def test_planted_files_are_not_run(folder, tmp_path, caplog, plant, kind):
    doubled()
    [file] = folder.rglob(kind)
    file.unlink()
    plant(file, pickle.dumps(Planted(tmp_path / 'proof')))
    assert doubled() == (6, 0)
    assert not (tmp_path / 'proof').exists()
    assert len(caplog.messages) == 1


def test_a_pipe_in_place_of_an_index_does_not_hang(folder):
    doubled()
    [file] = folder.rglob(INDEX)
    file.unlink()
    os.mkfifo(file)
    assert doubled() == (6, 0)
    assert doubled() == (6, 1)


def test_files_are_the_users_alone_whatever_the_umask(folder):
    before = os.umask(0)
    try:
        doubled()
    finally:
        os.umask(before)
    assert all(file.stat().st_mode & 0o777 == 0o600 for file in folder.rglob('*.nb?'))
    assert doubled() == (6, 1)


@pytest.fixture
def full():
    """No file may grow, as on a disk that is full."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, before[1]))
    yield
    resource.setrlimit(resource.RLIMIT_FSIZE, before)


def test_on_a_full_disk_kernels_run_and_nothing_is_left(folder, full, caplog):
    assert doubled() == (6, 0)
    assert doubled() == (6, 0)
    assert [file for file in folder.rglob('*') if file.is_file()] == []
    [line] = caplog.messages
    assert 'cannot be kept' in line and 'set NUMBA_CACHE_DIR' in line


def test_a_folder_that_vanished_under_way_does_no_harm(folder, caplog):
    folder.rmdir()
    folder.write_text('')
    assert doubled() == (6, 0)
    assert len(caplog.messages) == 2  # neither read nor kept


def test_without_any_folder_kernels_run(monkeypatch):
    monkeypatch.setattr(cache_files, 'cache_folder', lambda: None)
    assert doubled() == (6, 0)


# Which folder


@pytest.fixture
def places(tmp_path, monkeypatch):
    result = [tmp_path / 'first', tmp_path / 'second']
    monkeypatch.setattr(cache, '_places', lambda: iter(result))
    monkeypatch.setattr(cache, 'fingerprint', lambda: 'test')
    return result


def folder_taken():
    return cache.cache_folder.__wrapped__()


def make_writable_by_group(folder):
    folder.mkdir(parents=True)
    folder.chmod(0o770)


def make_writable_by_all(folder):
    folder.mkdir(parents=True)
    folder.chmod(0o707)


def make_symlink(folder):
    folder.parent.mkdir()
    (folder.parent / 'elsewhere').mkdir(mode=0o700)
    folder.symlink_to('elsewhere')


def make_in_a_place_of_all(folder):
    folder.mkdir(parents=True, mode=0o700)
    folder.parent.chmod(0o777)


def make_of_another_user(folder):
    if os.geteuid():
        pytest.skip('only root can give a folder away')
    folder.mkdir(parents=True, mode=0o700)
    os.chown(folder, 12345, 12345)


@pytest.mark.parametrize('make', [
    make_writable_by_group, make_writable_by_all, make_symlink, make_in_a_place_of_all, make_of_another_user])
def test_a_folder_that_others_may_write_to_is_passed_by_with_one_line(places, caplog, make):
    make(places[0] / 'svdm_kernels_test')
    assert folder_taken() == places[1] / 'svdm_kernels_test'
    [line] = caplog.messages
    assert str(places[0]) in line and 'a folder of your own' in line


def test_a_folder_of_ours_in_a_shared_place_is_taken(places, caplog):
    places[0].mkdir()
    places[0].chmod(0o1777)
    assert folder_taken() == places[0] / 'svdm_kernels_test'
    assert folder_taken().stat().st_mode & 0o777 == 0o700
    assert caplog.messages == []


def test_a_full_disk_with_kernels_serves_them_and_one_without_is_told(places, full, caplog):
    folder = places[1] / 'svdm_kernels_test'
    assert folder_taken().name.startswith('svdm_kernels_')
    assert 'nothing can be written' in caplog.messages[0]
    caplog.clear()
    (folder / 'a.nbi').touch()
    assert folder_taken() == folder
    assert caplog.messages == []
