"""A bag under construction: readable after every commit, gone on with, finished at once, never begun twice."""
import hashlib
import itertools
import subprocess
import sys

import pytest
import recordings
from recordings import LEFT, LEFT_INFO, contents, stereo

from svdm_ros.bags.reading.recording import open_recording
from svdm_ros.bags.writing import partial_bag
from svdm_ros.bags.writing.partial_bag import OutputTopic, open_partial
from svdm_ros.bags.writing.partial_folder import partial_path

TOPICS = [OutputTopic(LEFT, 'sensor_msgs/msg/Image', recordings.ROS2),
          OutputTopic(LEFT_INFO, 'sensor_msgs/msg/CameraInfo', recordings.ROS2)]
SETTINGS = {'alpha': 3.0}


@pytest.fixture(autouse=True)
def small_files(monkeypatch):
    monkeypatch.setattr(partial_bag, 'SEGMENT_BYTES', 12_000)
    monkeypatch.setattr(partial_bag, 'VOLUME_BYTES', 50_000)


@pytest.fixture(scope='module')
def messages():
    """(topic, time, CDR): an image and a camera_info in turn."""
    kinds = {LEFT: 'sensor_msgs/msg/Image', LEFT_INFO: 'sensor_msgs/msg/CameraInfo'}
    return [(topic, time_ns, bytes(recordings.ROS2.serialize_cdr(message, kinds[topic])))
            for topic, time_ns, message in stereo(40) if topic in kinds]


def fill(bag, messages):
    """Write from where the bag is, a pair of messages a commit."""
    for number, two in enumerate(itertools.batched(messages, 2)):
        if number >= bag.state.get('done', 0):
            for message in two:
                bag.write(*message)
            bag.commit({'done': number + 1})


def finished(output, messages, force=False):
    with open_partial(output, TOPICS, SETTINGS, force=force) as bag:
        fill(bag, messages)
        bag.commit({'done': len(messages) // 2}, now=True)
        bag.finish(lambda folder: (folder / 'summary.json').write_text('whole'))
    return output


@pytest.fixture(scope='module')
def expected(messages):
    return [(topic, time_ns, hashlib.sha256(data).hexdigest()) for topic, time_ns, data in messages]


def test_the_finished_bag_holds_all_of_it_in_files_of_a_volume(tmp_path, messages, expected):
    output = finished(tmp_path / 'out', messages)
    assert contents(output) == expected
    assert not partial_path(output).exists()
    files = sorted(path.name for path in output.iterdir())
    assert files == ['metadata.yaml', *(f'out_{number}.mcap' for number in range(5)), 'summary.json']
    for file in output.glob('*.mcap'):
        assert set(contents(file)) <= set(expected)
    with open_recording(output) as recording:
        assert [recording.topics[topic.name].count for topic in TOPICS] == [40, 40]
        assert (recording.start_ns, recording.end_ns) == (messages[0][1], messages[-1][1] + 1)


def test_a_small_bag_is_one_file(tmp_path, messages, expected):
    output = finished(tmp_path / 'out', messages[:8])
    assert [path.name for path in output.glob('*.mcap')] == ['out_0.mcap']
    assert contents(output) == expected[:8]


def test_at_every_moment_the_partial_bag_is_a_bag_of_whole_messages(tmp_path, messages, expected):
    output = tmp_path / 'out'
    sizes = []
    with open_partial(output, TOPICS, SETTINGS, force=False) as bag:
        for number, message in enumerate(messages):
            found = contents(partial_path(output))
            assert found == expected[:len(found)]
            sizes.append(len(found))
            bag.write(*message)
            if number % 2:
                bag.commit({'done': number // 2 + 1})
    assert sizes[0] == 0 and sizes[-1] >= 72
    assert len(set(sizes)) > 8


def test_what_is_interrupted_is_gone_on_with(tmp_path, messages, expected):
    output = tmp_path / 'out'
    for upto in (10, 30, 60):
        with open_partial(output, TOPICS, SETTINGS, force=False) as bag:
            fill(bag, messages[:upto])
        done = len(contents(partial_path(output)))
        assert 0 < done <= upto
    assert contents(finished(output, messages)) == expected


@pytest.mark.parametrize('stop', [0, 1, 2, 3, 7, 8, 9, 10, 20, 21, 34, 35])
def test_a_kill_between_two_renamings_leaves_a_bag_and_costs_nothing(
        tmp_path, messages, expected, monkeypatch, stop):
    output = tmp_path / 'out'
    replace, steps = partial_bag.os.replace, itertools.count()

    def killed(source, target):
        if next(steps) == stop:
            raise KeyboardInterrupt
        replace(source, target)

    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(partial_bag.os, 'replace', killed)
        # A kill tidies nothing up.
        patch.setattr(partial_bag.PartialBag, 'abandon_segment', lambda bag: None)
        finished(output, messages)
    if stop > 1:  # before that there is no bag yet
        found = contents(partial_path(output))
        assert found == expected[:len(found)]
    assert contents(finished(output, messages)) == expected


def test_other_settings_are_refused_unless_it_is_begun_anew(tmp_path, messages, expected):
    output = tmp_path / 'out'
    with open_partial(output, TOPICS, SETTINGS, force=False) as bag:
        fill(bag, messages[:20])
    other = {'alpha': 4.0}
    with (pytest.raises(ValueError, match=r'out\.partial was begun with a different alpha: .*--force'),
          open_partial(output, TOPICS, other, force=False)):
        pass
    with open_partial(output, TOPICS, other, force=True) as bag:
        assert bag.state == {}
    assert contents(partial_path(output)) == []


def test_a_second_process_is_refused(tmp_path, messages):
    output = tmp_path / 'out'
    code = ('import sys; from pathlib import Path; from svdm_ros.bags.writing.partial_bag import open_partial\n'
            'with open_partial(Path(sys.argv[1]), [], {}, force=True): pass')
    with open_partial(output, TOPICS, SETTINGS, force=False) as bag:
        fill(bag, messages[:20])
        run = subprocess.run([sys.executable, '-c', code, output], capture_output=True, text=True, timeout=60)
        assert 'another process is writing it' in run.stderr
    assert len(contents(partial_path(output))) > 0


def test_a_bag_of_the_same_name_is_replaced_in_the_end_only(tmp_path, messages, expected):
    output = finished(tmp_path / 'out', messages[:20])
    with open_partial(output, TOPICS, SETTINGS, force=True) as bag:
        fill(bag, messages)
        assert contents(output) == expected[:20]
    with pytest.raises(ValueError, match='out exists already'):
        finished(output, messages)
    assert contents(output) == expected[:20]
    assert contents(finished(output, messages, force=True)) == expected
    assert [path.name for path in tmp_path.iterdir()] == ['out']
