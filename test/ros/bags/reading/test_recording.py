"""Recordings of every kind give the same messages; what is damaged is told in one line."""
import pytest
import recordings
from backports import zstd
from recordings import LEFT, LEFT_INFO, MS, RIGHT, contents, stamp, stereo, write, write_ros1

from svdm_ros.bags.reading.recording import RecordingError, open_recording


@pytest.fixture(scope='module')
def plain(tmp_path_factory):
    return write(tmp_path_factory.mktemp('plain') / 'bag', stereo(6))


@pytest.mark.parametrize(('storage', 'compression'), [
    ('mcap', 'message'), ('mcap', 'file'), ('mcap', 'storage'), ('sqlite3', None), ('sqlite3', 'message'),
    ('sqlite3', 'file')])
def test_any_storage_and_compression_gives_the_same(plain, tmp_path, storage, compression):
    assert contents(write(tmp_path / 'bag', stereo(6), storage, compression)) == contents(plain)
    assert len(contents(plain)) == 24


@pytest.mark.parametrize('storage', ['mcap', 'sqlite3'])
def test_a_single_file_without_metadata_is_enough(plain, tmp_path, storage):
    bag = write(tmp_path / 'bag', stereo(6), storage)
    (bag / 'metadata.yaml').unlink()
    [file] = bag.iterdir()
    packed = tmp_path / f'{file.name}.zstd'
    packed.write_bytes(zstd.compress(file.read_bytes()))
    assert contents(bag) == contents(file) == contents(packed) == contents(plain)


def test_the_files_of_a_split_bag_without_metadata_are_one_recording(plain, tmp_path):
    whole = list(stereo(12))
    folder = tmp_path / 'split'
    folder.mkdir()
    for number, part in enumerate((whole[:24], whole[24:])):
        bag = write(tmp_path / f'part{number}', part)
        (bag / f'part{number}.mcap').rename(folder / f'split_{number}.mcap')
    with open_recording(folder) as recording:
        assert recording.topics[LEFT].count == 12
        assert [message.time_ns for message in recording.messages([LEFT])] == [stamp(i) + 3 * MS for i in range(12)]
    assert contents(folder)[:24] == contents(plain)


def test_a_ros1_bag_gives_the_same_bytes_as_a_rosbag2(plain, tmp_path):
    bag = write_ros1(tmp_path / 'a.bag', stereo(6, types=recordings.ROS1))
    assert contents(bag) == contents(plain)


def test_topics_times_and_ranges(plain):
    with open_recording(plain) as recording:
        assert {name: topic.count for name, topic in recording.topics.items()} == dict.fromkeys(
            (LEFT, RIGHT, LEFT_INFO, recordings.RIGHT_INFO), 6)
        assert recording.topics[LEFT].message_type == 'sensor_msgs/msg/Image'
        assert recording.start_ns == stamp(0) + 3 * MS
        assert recording.end_ns == stamp(5) + 6 * MS + 1
        some = list(recording.messages([LEFT, LEFT_INFO], stamp(1), stamp(2)))
        assert [(message.topic, message.time_ns) for message in some] == [
            (LEFT, stamp(1) + 3 * MS), (LEFT_INFO, stamp(1) + 5 * MS)]
        assert list(recording.messages([])) == list(recording.messages(['/none'])) == []


def test_an_empty_recording_has_no_messages(tmp_path):
    with open_recording(write(tmp_path / 'bag', [])) as recording:
        assert (recording.topics, recording.start_ns, recording.end_ns) == ({}, 0, 0)
        assert list(recording.messages()) == []


@pytest.mark.parametrize(('make', 'told'), [
    (lambda bag, path: None, 'there is no such file or folder'),
    (lambda bag, path: path.mkdir(), 'neither metadata.yaml nor .mcap nor .db3'),
    (lambda bag, path: path.write_text('no bag'), r"the suffix '' is none of a recording: .mcap, .db3, .bag"),
])
def test_what_is_no_recording_is_told_in_one_line(plain, tmp_path, make, told):
    path = tmp_path / 'input'
    make(plain, path)
    with pytest.raises(RecordingError, match=f'input: .*{told}') as caught, open_recording(path):
        pass
    assert '\n' not in str(caught.value)


@pytest.mark.parametrize(('storage', 'keep', 'told'), [
    ('mcap', 0.6, 'cut off.*mcap recover'), ('mcap', 0.0, 'cut off'), ('sqlite3', 0.6, 'malformed'),
    ('sqlite3', 0.0, 'missing tables')])
def test_a_file_that_is_cut_off_is_told_in_one_line(tmp_path, storage, keep, told):
    bag = write(tmp_path / 'bag', stereo(30), storage)
    [file] = (path for path in bag.iterdir() if path.suffix != '.yaml')
    file.write_bytes(file.read_bytes()[:int(keep * file.stat().st_size)])
    with pytest.raises(RecordingError, match=told) as caught:
        contents(bag)
    assert '\n' not in str(caught.value)


def test_a_ros1_bag_that_was_not_closed_says_how_to_mend_it(tmp_path):
    bag = write_ros1(tmp_path / 'a.bag', stereo(3, types=recordings.ROS1))
    data = bytearray(bag.read_bytes())
    at = data.index(b'index_pos=') + len(b'index_pos=')
    data[at:at + 8] = bytes(8)
    bag.write_bytes(data)
    with pytest.raises(RecordingError, match='rosbag reindex'), open_recording(bag):
        pass


def test_damage_inside_is_told_where_it_is_met_and_what_comes_before_is_there(tmp_path):
    bag = write(tmp_path / 'bag', stereo(600), compression='storage')
    file = bag / 'bag.mcap'
    data = bytearray(file.read_bytes())
    data[1_500_000:2_700_000] = bytes(1_200_000)  # more than a chunk
    file.write_bytes(data)
    with open_recording(bag) as recording:
        read = []
        with pytest.raises(RecordingError, match='damaged'):
            for message in recording.messages():
                read.append(message.time_ns)
    assert 100 < len(read) < 2400
