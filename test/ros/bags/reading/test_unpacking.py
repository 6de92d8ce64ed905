"""What unpacks to more than a recording can hold is refused in one line, before memory or disk are full."""
import resource

import pytest
from backports import zstd
from mcap_files import cdr_entries, write_mcap
from recordings import write
from small_recordings import few, refused

from svdm_ros.bags.reading import unpacking


def bomb(size=2**29):
    """A few kB of zstd that unpack to `size` bytes, which its frame does not declare."""
    packer = zstd.ZstdCompressor()
    block = bytes(2**24)
    return b''.join(packer.compress(block) for _ in range(size // len(block))) + packer.flush()


@pytest.fixture(scope='module')
def packed_bomb():
    return bomb()


def test_a_packed_file_unpacks_to_no_more_than_is_allowed(tmp_path, packed_bomb, monkeypatch):
    monkeypatch.setattr(unpacking, 'ALWAYS_ALLOWED', 2**24)
    path = tmp_path / 'a.mcap.zstd'
    path.write_bytes(packed_bomb)
    assert f'{path}: it unpacks to more than 16777216 bytes' in refused(path)
    path.write_bytes(zstd.compress(bytes(2**25)))
    assert f'{path}: it declares 33554432 bytes unpacked, at most 16777216 are allowed' in refused(path)


def test_chunks_and_messages_unpack_to_no_more_than_is_allowed(tmp_path, packed_bomb, monkeypatch):
    monkeypatch.setattr(unpacking, 'ALWAYS_ALLOWED', 2**24)
    channels, entries = cdr_entries(few(1))
    chunk = write_mcap(tmp_path / 'a.mcap', channels, entries, pack=lambda data: ('zstd', packed_bomb))
    assert 'a block unpacks to more than' in refused(chunk)
    message = write_mcap(tmp_path / 'b.mcap', channels, [(*entries[0][:2], packed_bomb)])
    assert 'a block unpacks to more than 16777216 bytes' in refused(message)


def test_a_temporary_folder_that_is_full_is_named(tmp_path, monkeypatch):
    """No file may grow beyond 1 kB: an error of the system in the same place as that of a full disk."""
    monkeypatch.setattr('tempfile.tempdir', str(tmp_path))
    path = tmp_path / 'a.mcap.zstd'
    path.write_bytes(zstd.compress(next(write(tmp_path / 'bag', few()).glob('*.mcap')).read_bytes()))
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, hard))
    try:
        line = refused(path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))
    assert f'the temporary folder {tmp_path}, which has no room (File too large): make room there, set TMPDIR' in line
    assert sorted(found.name for found in tmp_path.iterdir()) == ['a.mcap.zstd', 'bag']
