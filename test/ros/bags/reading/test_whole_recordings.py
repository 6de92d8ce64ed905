"""What a file holds is read, whatever its recorder or others left out around it; what is not read is told."""
import shutil
import sqlite3

import pytest
import recordings
import yaml
from mcap_files import cdr_entries, write_mcap
from recordings import LEFT, RIGHT, ROS1, contents, stamp, write, write_ros1
from small_recordings import few, notes_of, refused

from svdm_ros.bags.reading.recording import open_recording

pytest_plugins = ['plain_recording']

ROOT = 'rosbag2_bagfile_information'


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


# Where messages lie


def test_where_the_images_lie_is_told(tmp_path):
    messages = few()
    early = (messages[0][0].replace('image_rect', 'early'), stamp(0) - 3600 * 10**9, recordings.camera_info('left', 0))
    with open_recording(write(tmp_path / 'bag', [early, *messages])) as recording:
        assert recording.where([LEFT, RIGHT]) == (
            '; they lie from 3600.003 to 3600.504 s after the beginning of the recording: --start 3600.003 begins with '
            'them')
        assert recording.where(['/none']) == ''
