"""Files of .mcap: read with or without their indexes, and what is not read of them is told."""
import struct
import zlib

import mcap_files
import pytest
import recordings
from backports import zstd
from mcap_files import cdr_entries, write_mcap
from recordings import LEFT, MS, ROS1, contents, stamp
from small_recordings import few, notes_of, refused

from svdm_ros.bags.reading import mcap_file
from svdm_ros.bags.reading.recording import open_recording
from svdm_ros.bags.reading.storage import StoredMessage

pytest_plugins = ['plain_recording']


@pytest.mark.parametrize('options', [
    {}, {'indexed': lambda chunk: False}, {'indexed': lambda chunk: chunk != 1}, {'summary': False},
    {'chunked': False}, {'chunked': False, 'summary': False}, {'profile': ''}, {'profile': 'ros1'},
    {'pack': lambda data: ('zstd', zstd.compress(data))}], ids=[
    'plain', 'no index', 'one index', 'no summary', 'no chunks', 'neither', 'no profile', 'ros1', 'zstd'])
def test_an_mcap_file_is_read_with_or_without_its_indexes(plain, tmp_path, options):
    assert contents(write_mcap(tmp_path / 'a.mcap', *cdr_entries(few()), **options)) == plain


@pytest.mark.parametrize('options', [{}, {'summary': False}, {'chunked': False}], ids=str)
def test_messages_that_are_not_in_order_are_read_in_order(plain, tmp_path, options):
    channels, entries = cdr_entries(few())
    entries = entries[5::-1] + entries[6:]
    assert contents(write_mcap(tmp_path / 'a.mcap', channels, entries, **options)) == plain


@pytest.mark.parametrize('options', [{}, {'summary': False}], ids=str)
def test_channels_of_other_encodings_are_left_out_and_told(plain, tmp_path, options):
    channels, entries = cdr_entries(few())
    channels.append(('/status', 'foxglove.Status', 'protobuf', 'x'))
    entries.insert(3, (len(channels), entries[2][1], b'\x08\x01'))
    path = write_mcap(tmp_path / 'a.mcap', channels, entries, **options)
    assert contents(path) == plain
    assert notes_of(path) == (f"{path}: left out: '/status', 1 messages of encoding 'protobuf': cdr and ros1 are read",)


def test_ros1_messages_in_an_mcap_file_are_converted(plain, tmp_path):
    types, channels, entries = ROS1, {}, []
    for topic, time_ns, content in few(types=ROS1):
        kind = content.__msgtype__
        channels.setdefault(topic, (topic, kind.replace('/msg/', '/'), 'ros1', types.generate_msgdef(kind)[0]))
        entries.append((list(channels).index(topic) + 1, time_ns, bytes(types.serialize_ros1(content, kind))))
    path = write_mcap(tmp_path / 'a.mcap', list(channels.values()), entries, profile='ros1')
    assert contents(path) == plain


def test_a_type_whose_name_is_no_name_is_left_out(plain, tmp_path):
    """Names get into Python code that is run."""
    channels, entries = cdr_entries(few())
    hostile = "a/b': ([], []), **print('run'), 'c"
    channels.append(('/hostile', hostile, 'cdr', 'uint8 x'))
    path = write_mcap(tmp_path / 'a.mcap', channels, [*entries, (len(channels), entries[-1][1], b'\0\1\0\0\5')])
    assert contents(path) == plain
    assert 'whose definition cannot be read' in notes_of(path)[0]


@pytest.mark.parametrize(('was', 'becomes'), [('uint32 height', 'uint32 heigQt'), ('float64[9]', 'float64[1]')])
def test_a_type_that_is_used_and_has_other_fields_is_left_out(plain, tmp_path, was, becomes):
    channels, entries = cdr_entries(few())
    [at] = [number for number, channel in enumerate(channels) if channel[0] == recordings.LEFT_INFO]
    assert was in channels[at][3]
    channels[at] = (*channels[at][:3], channels[at][3].replace(was, becomes))
    path = write_mcap(tmp_path / 'a.mcap', channels, entries)
    assert contents(path) == [entry for entry in plain if entry[0] != recordings.LEFT_INFO]
    assert f"left out: '{recordings.LEFT_INFO}', 6 messages of type" in notes_of(path)[0]


def summary_of(data):
    """Where the summary begins, and where the footer does."""
    footer = len(data) - len(mcap_files.MAGIC) - 29
    return struct.unpack_from('<Q', data, footer + 9)[0], footer


def of_kind(data, kind):
    """Where the content of the first record of this kind in the summary begins."""
    at, footer = summary_of(data)
    while at < footer:
        found, size = struct.unpack_from('<BQ', data, at)
        if found == kind:
            return at + 9
        at += 9 + size
    raise AssertionError


def put(kind, offset, new):
    def damage(data):
        at = of_kind(data, kind) + offset
        data[at:at + len(new)] = new
    return damage


def wrong_text(data):
    at = data.index(b'uint32 height', summary_of(data)[0])
    data[at:at + 13] = b'uint32 heigQt'


def other_start(value):
    def damage(data):
        struct.pack_into('<Q', data, summary_of(data)[1] + 9, value)
    return damage


SHOWN = {
    'too long a record': put(mcap_files.SCHEMA, -8, b'\xff' * 4), 'too long a name': put(mcap_files.SCHEMA, 2, b'\xff'),
    'no text': put(mcap_files.CHANNEL, 8, b'\xff'), 'too short': put(mcap_files.STATISTICS, -8, b'\x05'),
    'counts': put(mcap_files.STATISTICS, 0, b'\x99'), 'no chunk there': put(mcap_files.CHUNK_INDEX, 16, b'\x99'),
    'begins nowhere': other_start(2**40), 'begins in the data': other_start(100),
    'begins in the header': other_start(1)}
BY_CHECKSUM = {'another channel': put(mcap_files.CHANNEL, 8, b'/x'), 'fields': wrong_text}


@pytest.mark.parametrize(('damage', 'checked'), [
    *((damage, False) for damage in SHOWN.values()), *((damage, True) for damage in BY_CHECKSUM.values())],
    ids=[*SHOWN, *BY_CHECKSUM])
def test_a_damaged_summary_leaves_the_data_readable(plain, tmp_path, damage, checked):
    path = write_mcap(tmp_path / 'a.mcap', *cdr_entries(few()))
    data = bytearray(path.read_bytes())
    begin, footer = summary_of(data)
    if checked:
        struct.pack_into('<I', data, footer + 25, zlib.crc32(data[begin:footer + 25]))
    damage(data)
    path.write_bytes(data)
    assert contents(path) == plain
    assert notes_of(path) == ()


def test_a_summary_with_its_checksum_is_gone_by(plain, tmp_path, monkeypatch):
    path = write_mcap(tmp_path / 'a.mcap', *cdr_entries(few()))
    data = bytearray(path.read_bytes())
    begin, footer = summary_of(data)
    struct.pack_into('<I', data, footer + 25, zlib.crc32(data[begin:footer + 25]))
    path.write_bytes(data)
    monkeypatch.delattr('svdm_ros.bags.reading.mcap_file.McapFile._scan')
    assert contents(path) == plain


@pytest.mark.parametrize('chunked', [True, False])
def test_messages_of_other_topics_are_not_copied(tmp_path, monkeypatch, chunked):
    path = write_mcap(tmp_path / 'a.mcap', *cdr_entries(few()), chunked=chunked)
    copied = []

    def stored(time_ns, channel, data):
        copied.append(channel)
        return StoredMessage(time_ns, channel, data)

    monkeypatch.setattr(mcap_file, 'StoredMessage', stored)
    with open_recording(path) as recording:
        assert len(list(recording.messages([LEFT]))) == len(copied) == 6


def test_fewer_messages_than_the_file_tells_of_are_told(tmp_path):
    """As where a byte has changed that makes a message of a chunk something else."""
    path = write_mcap(tmp_path / 'a.mcap', *cdr_entries(few()))
    data = bytearray(path.read_bytes())
    at = data.index(struct.pack('<HIQQ', 1, 0, stamp(3) + 3 * MS, stamp(3) + 3 * MS)) - 9
    assert data[at] == mcap_files.MESSAGE
    data[at] = 0x7f
    path.write_bytes(data)
    assert f'5 of the 6 messages on {LEFT} that it tells of can be read' in refused(path)
