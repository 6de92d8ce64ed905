"""What a file holds is read, whatever its recorder or others left out around it; what is not read is told."""
import resource
import shutil
import sqlite3
import struct
import zlib

import mcap_files
import numpy as np
import pytest
import recordings
import yaml
from backports import zstd
from mcap_files import cdr_entries, write_mcap
from recordings import LEFT, MS, RIGHT, ROS1, contents, stamp, stereo, write, write_ros1

from svdm_ros.bags.reading import mcap_file, unpacking
from svdm_ros.bags.reading.recording import RecordingError, open_recording
from svdm_ros.bags.reading.storage import StoredMessage

ROOT = 'rosbag2_bagfile_information'


def tiny(index):
    return np.full((4, 8), index, np.uint8), np.full((4, 8), index + 1, np.uint8)


def few(count=6, **options):
    return list(stereo(count, pixels=tiny, **options))


@pytest.fixture(scope='module')
def plain(tmp_path_factory):
    return contents(write(tmp_path_factory.mktemp('plain') / 'bag', few()))


def notes_of(path):
    with open_recording(path) as recording:
        return recording.notes


def refused(path):
    with pytest.raises(RecordingError) as caught:
        contents(path)
    assert '\n' not in str(caught.value)
    return str(caught.value)


# sqlite3


def killed_recorder(folder, messages, written):
    """What a recorder in WAL mode leaves that was killed: rows from `written` on are in the log only."""
    source = next(write(folder.with_name('source'), messages, 'sqlite3').glob('*.db3'))
    folder.mkdir()
    live = folder.with_name('live.db3')
    shutil.copy(source, live)
    database = sqlite3.connect(live, isolation_level=None)
    rows = database.execute('SELECT * FROM messages ORDER BY id').fetchall()
    database.execute('DELETE FROM messages')
    database.execute('PRAGMA journal_mode = WAL')
    database.execute('PRAGMA wal_autocheckpoint = 0')
    for number, row in enumerate(rows):
        if number == written:
            database.execute('PRAGMA wal_checkpoint(TRUNCATE)')
        database.execute(f'INSERT INTO messages VALUES ({",".join("?" * len(row))})', row)
    for suffix in ('', '-wal'):
        shutil.copy(f'{live}{suffix}', folder / f'bag?#_0.db3{suffix}')
    database.close()
    return folder


@pytest.mark.parametrize('written', [0, 12])
def test_the_write_ahead_log_is_read_and_nothing_is_written(plain, tmp_path, written):
    folder = killed_recorder(tmp_path / 'bag', few(), written)
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    folder.chmod(0o555)
    assert contents(folder) == contents(folder / 'bag?#_0.db3') == plain
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before
    folder.chmod(0o755)


def test_the_log_of_a_database_is_found_through_symlinks(plain, tmp_path):
    folder = killed_recorder(tmp_path / 'bag', few(), 12)
    links, link = tmp_path / 'links', tmp_path / 'other.db3'
    links.mkdir()
    for path in (links / 'a.db3', link):
        path.symlink_to(folder / 'bag?#_0.db3')
    assert contents(links) == contents(link) == plain
    link.unlink()
    (tmp_path / 'a-wal').write_bytes((folder / 'bag?#_0.db3-wal').read_bytes())
    (folder / 'bag?#_0.db3-wal').unlink()
    (links / 'a.db3-wal').symlink_to(tmp_path / 'a-wal')
    assert 'its log a.db3-wal is not beside ' in refused(links / 'a.db3')


def test_a_log_that_is_no_file_is_refused(tmp_path):
    import os
    bag = write(tmp_path / 'bag', few(1), 'sqlite3')
    os.mkfifo(bag / 'bag.db3-wal')
    assert 'bag.db3-wal is a pipe' in refused(bag)


def test_a_database_without_an_index_is_read_in_order_of_time(plain, tmp_path):
    bag = write(tmp_path / 'bag', few()[::-1], 'sqlite3')
    with sqlite3.connect(bag / 'bag.db3') as database:
        for [name] in database.execute('SELECT name FROM sqlite_master WHERE type = "index"').fetchall():
            database.execute(f'DROP INDEX {name}')
    database.close()
    assert contents(bag) == plain


def test_messages_of_other_encodings_in_a_database_are_left_out_and_told(plain, tmp_path):
    bag = write(tmp_path / 'bag', few(), 'sqlite3')
    with sqlite3.connect(bag / 'bag.db3') as database:
        database.execute('UPDATE topics SET serialization_format = "json" WHERE name = ?', (RIGHT,))
    database.close()
    assert contents(bag) == [entry for entry in plain if entry[0] != RIGHT]
    assert f"left out: '{RIGHT}', 6 messages of encoding 'json'" in notes_of(bag)[0]


@pytest.mark.parametrize('count', [3, 24])
def test_messages_with_times_below_0_in_a_database_are_left_out_and_told(plain, tmp_path, count):
    bag = write(tmp_path / 'bag', few(), 'sqlite3')
    with sqlite3.connect(bag / 'bag.db3') as database:
        database.execute('UPDATE messages SET timestamp = timestamp - ? WHERE id <= ?', (2 * stamp(0), count))
    database.close()
    (bag / 'metadata.yaml').unlink()
    with open_recording(bag) as recording:
        assert recording.start_ns == (plain[count][1] if count < len(plain) else 0)
        assert len(list(recording.messages(start_ns=-2**63))) == len(plain) - count
    assert contents(bag) == plain[count:]
    assert notes_of(bag) == (f'{bag}: left out: {count} messages with recording times below 0',)


@pytest.mark.parametrize('options', [{}, {'chunked': False}, None], ids=['mcap', 'no chunks', 'sqlite3'])
def test_a_message_of_the_latest_time_is_read(plain, tmp_path, options):
    messages = few()
    messages[-1] = (messages[-1][0], 2**63 - 1, messages[-1][2])
    path = (write(tmp_path / 'bag', messages, 'sqlite3') if options is None
            else write_mcap(tmp_path / 'a.mcap', *cdr_entries(messages), **options))
    assert contents(path) == [*plain[:-1], (plain[-1][0], 2**63 - 1, plain[-1][2])]


# Types


def with_another(channel, data):
    """Channels and entries of `few`, with one message of one more channel."""
    channels, entries = cdr_entries(few())
    entries.append((len(channels) + 1, entries[-1][1] + 1, data))
    return [*channels, channel], entries


@pytest.mark.parametrize('first', [False, True])
@pytest.mark.parametrize('topic', [LEFT, recordings.LEFT_INFO])
def test_a_topic_of_two_types_is_read_as_the_one_that_is_used(plain, tmp_path, topic, first):
    channels, entries = with_another((topic, 'std_msgs/msg/String', 'cdr', 'string data'), b'\0\1\0\0\2\0\0\0a\0')
    if first:
        channels.insert(0, channels.pop())
        entries = [(number % len(channels) + 1, *rest) for number, *rest in entries]
    path = write_mcap(tmp_path / 'a.mcap', channels, entries)
    assert contents(path) == plain
    [note] = notes_of(path)
    assert f"left out: '{topic}', 1 messages of type 'std_msgs/msg/String': the topic is read as 'sensor_msgs/" in note


def definition(fields, **nested):
    parts = [fields, *(f'MSG: std_msgs/{name}\n{text}' for name, text in nested.items())]
    return f'\n{"=" * 80}\n'.join(parts)


@pytest.mark.parametrize('first', [False, True])
def test_a_channel_that_defines_a_needed_type_otherwise_is_left_out(plain, tmp_path, first):
    old = definition('std_msgs/Header header', Header='uint32 seq\nbuiltin_interfaces/Time stamp\nstring frame_id')
    old += f'\n{"=" * 80}\nMSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec'
    channels, entries = with_another(('/c', 'a/msg/C', 'cdr', old), bytes(32))
    if first:
        channels.insert(0, channels.pop())
        entries = [(number % len(channels) + 1, *rest) for number, *rest in entries]
    path = write_mcap(tmp_path / 'a.mcap', channels, entries)
    assert contents(path) == plain
    [note] = notes_of(path)
    assert ("left out: '/c', 1 messages of type 'a/msg/C', which defines 'std_msgs/msg/Header' otherwise than ROS 2 "
            'does') in note


def test_of_two_definitions_of_one_name_the_first_is_read(plain, tmp_path):
    channels, entries = with_another(('/c', 'a/msg/C', 'cdr', 'uint8 x'), b'\0\1\0\0\5')
    channels += [('/d', 'a/msg/C', 'cdr', 'uint8[4] x'), ('/e', 'a/msg/C', 'cdr', 'uint8 x  # the same')]
    entries += [(len(channels) - 1, entries[-1][1] + 1, bytes(8)), (len(channels), entries[-1][1] + 2, b'\0\1\0\0\6')]
    path = write_mcap(tmp_path / 'a.mcap', channels, entries)
    found = contents(path)
    assert found[:-2] == plain
    assert [topic for topic, _, _ in found[-2:]] == ['/c', '/e']
    [note] = notes_of(path)
    assert "left out: '/d', 1 messages of type 'a/msg/C', which defines 'a/msg/C' otherwise than another topic" in note


# metadata.yaml


def edit(change):
    def apply(bag):
        path = bag / 'metadata.yaml'
        document = yaml.safe_load(path.read_text())
        change(document[ROOT])
        path.write_text(yaml.safe_dump(document))
    return apply


def rename(information):
    for topic in information['topics_with_message_count']:
        topic['topic_metadata']['name'] = '/other' + topic['topic_metadata']['name']


def best_effort(information):
    for topic in information['topics_with_message_count']:
        for profile in topic['topic_metadata']['offered_qos_profiles']:
            profile['reliability'] = 'best_effort'


EDITS = {
    'empty': (lambda bag: (bag / 'metadata.yaml').write_text(''), 'no metadata of a rosbag2'),
    'cut': (lambda bag: (bag / 'metadata.yaml').write_text('a: ['), 'no YAML'),
    'newer': (edit(lambda told: told.update(version=10)), 'its version is 10, versions 1 to 9 are known: read without'),
    'no storage': (edit(lambda told: told.update(storage_identifier='')), "its storage_identifier is ''"),
    'no files': (edit(lambda told: told.update(relative_file_paths=[])), 'it names no files'),
    'renamed': (edit(rename), 'tells of 4 topics that its files do not hold'),
    'qos': (edit(best_effort), None),
    'more': (edit(lambda told: told['topics_with_message_count'][0].update(message_count=7)),
             'tells of 7 messages on .* the files hold 6'),
}


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
@pytest.mark.parametrize('kind', EDITS)
def test_what_the_files_hold_is_read_whatever_metadata_tells(plain, tmp_path, storage, kind):
    bag = write(tmp_path / 'bag', few(), storage)
    apply, note = EDITS[kind]
    apply(bag)
    assert contents(bag) == plain
    found = notes_of(bag)
    assert len(found) == (1 if note else 0)
    if note:
        import re
        assert re.search(f'^{bag}.*{note}', found[0]), found


@pytest.mark.parametrize('storage', ['mcap', 'db3'])
def test_a_file_that_metadata_does_not_name_is_told(plain, tmp_path, storage):
    bag = write(tmp_path / 'bag', few(), {'db3': 'sqlite3'}.get(storage, storage))
    for name in (f'bag_10.{storage}.zstd', f'bag_2.{storage}', 'notes.txt'):
        (bag / name).write_bytes(b'')
    assert contents(bag) == plain
    assert notes_of(bag) == (f"{bag}: 2 files beside metadata.yaml are not read, the first 'bag_2.{storage}': it does "
                             'not name them; to read all files, remove metadata.yaml',)


def test_qos_of_metadata_is_that_of_the_topics(tmp_path):
    bag = write(tmp_path / 'bag', few(1))
    qos = [{'history': 1, 'depth': 5, 'reliability': 2, 'durability': 2, 'deadline': {'sec': 0, 'nsec': 0},
            'lifespan': {'sec': 0, 'nsec': 0}, 'liveliness': 1, 'liveliness_lease_duration': {'sec': 0, 'nsec': 0},
            'avoid_ros_namespace_conventions': False}]
    edit(lambda told: told['topics_with_message_count'][0]['topic_metadata'].update(
        offered_qos_profiles=yaml.safe_dump(qos)))(bag)
    with open_recording(bag) as recording:
        assert [profile.depth for topic in recording.topics.values() for profile in topic.qos] == [5]


@pytest.mark.parametrize(('storage', 'compression'), [('mcap', 'message'), ('sqlite3', 'message'), ('mcap', 'file')])
def test_packed_messages_and_files_need_no_metadata(plain, tmp_path, storage, compression):
    bag = write(tmp_path / 'bag', few(), storage, compression)
    (bag / 'metadata.yaml').unlink()
    assert contents(bag) == plain


# mcap


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


# Several files


@pytest.mark.parametrize('storage', ['mcap', 'db3'])
@pytest.mark.parametrize('keep', [0, 0.6])
def test_a_torn_last_file_is_left_out_and_named(plain, tmp_path, storage, keep):
    folder = tmp_path / 'split'
    folder.mkdir()
    for number in range(2):
        bag = write(tmp_path / str(number), few(), {'db3': 'sqlite3'}.get(storage, storage))
        shutil.copy(bag / f'{number}.{storage}', folder / f'split_{number}.{storage}')
    torn = folder / f'split_1.{storage}'
    torn.write_bytes(torn.read_bytes()[:int(keep * torn.stat().st_size)])
    assert contents(folder) == plain
    with open_recording(folder) as recording:
        [line] = recording.missing
        assert line.startswith(f'left out: {torn}: ')


def test_folders_that_are_several_recordings_say_what_to_give(tmp_path):
    bag = write_ros1(tmp_path / 'a.bag', few(1, types=ROS1))
    assert f'{tmp_path}: a folder of 1 ROS 1 bags, the first a.bag: give the files' in refused(tmp_path)
    active = bag.rename(tmp_path / 'a.bag.active')
    assert 'its recorder has not closed it: mend it with `rosbag reindex`, then rename it to a.bag' in refused(active)
    assert 'a folder of 1 ROS 1 bags' in refused(tmp_path)
    for storage in ('mcap', 'sqlite3'):
        bag = write(tmp_path / storage, few(1), storage)
        for file in bag.iterdir():
            if file.name != 'metadata.yaml':
                shutil.copy(file, tmp_path)
    assert 'it holds .mcap and .db3 files' in refused(tmp_path)


# What unpacks to too much


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


# Where messages lie


def test_where_the_images_lie_is_told(tmp_path):
    messages = few()
    early = (messages[0][0].replace('image_rect', 'early'), stamp(0) - 3600 * 10**9, recordings.camera_info('left', 0))
    with open_recording(write(tmp_path / 'bag', [early, *messages])) as recording:
        assert recording.where([LEFT, RIGHT]) == (
            '; they lie from 3600.003 to 3600.504 s after the beginning of the recording: --start 3600.003 begins with '
            'them')
        assert recording.where(['/none']) == ''
