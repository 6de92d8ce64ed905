"""process_bag --align-rows: estimated once, the same each time, kept through an interruption, told in the summary."""
import dataclasses
import itertools
import json
import pickle

import numpy as np
import pytest
from recordings import LEFT_INFO, RIGHT_INFO, contents, image, messages_of, stamp, stereo, write
from row_scenes import HEIGHT, WIDTH, difference, pair

from svdm_core import MatcherParameters, RowAlignment, StereoMatcher
from svdm_ros.bags.process import processing
from svdm_ros.bags.process.processing import Job, process
from svdm_ros.bags.process_bag import main
from svdm_ros.bags.reading.pair_stream import PairStream, RecordedPair
from svdm_ros.bags.reading.recorded_frames import stamp_ns
from svdm_ros.bags.reading.recording import open_recording
from svdm_ros.bags.reading.stereo_topics import find_stereo_topics
from svdm_ros.bags.writing.partial_bag import DamagedBagError
from svdm_ros.node.parameter_set import NodeParameters

FIELD = RowAlignment((0.3, 0, 0, 0.9, 0, 0), WIDTH, HEIGHT)
PARAMETERS = MatcherParameters(num_disparities=24, aggregation='box')
SET = ['--set', 'num_disparities=24', 'aggregation=box']
COUNT = 4


def recorded(path, field=FIELD, count=COUNT, change=lambda topic, time_ns, message: message):
    """A recording whose rows are apart by `field`."""
    messages = stereo(count, lambda index: pair('leaves', field, index), infos=True)
    return write(path, [(topic, time_ns, change(topic, time_ns, _resized(message) if 'info' in topic else message))
                        for topic, time_ns, message in messages])


def _resized(info):
    info.width, info.height = WIDTH, HEIGHT
    return info


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return recorded(tmp_path_factory.mktemp('input') / 'bag')


def job(bag, output, **options):
    return Job(bag, output, NodeParameters(PARAMETERS), **{'estimate_rows': True, **options})


def summary_of(folder):
    return json.loads((folder / 'summary.json').read_text())


def disparities(folder):
    return [np.frombuffer(message.image.data, np.float32) for _, message in messages_of(folder, '/disparity')]


def test_rows_are_aligned_by_what_the_recording_shows_and_by_a_file(bag, tmp_path, capsys):
    assert main([str(bag), str(tmp_path / 'out'), *SET, '--align-rows']) == 0
    assert 'rows aligned: offsets of the right image in px: centre +0.' in capsys.readouterr().out
    told = summary_of(tmp_path / 'out')['row_alignment']
    rows = RowAlignment(**told)
    assert difference(rows, FIELD) < 0.08 and told['points'] > 500
    assert told['residual_after'] < 0.2 < told['residual_before']
    expected = StereoMatcher(PARAMETERS).compute(*pair('leaves', FIELD, 0), rows).disparity.ravel()
    np.testing.assert_array_equal(disparities(tmp_path / 'out')[0] + 2, expected)  # principal points 2 px apart
    rows.save(tmp_path / 'rows.yaml')
    given = ['--align-rows', str(tmp_path / 'rows.yaml')]
    assert main([str(bag), str(tmp_path / 'file'), *SET, *given]) == 0
    assert contents(tmp_path / 'file') == contents(tmp_path / 'out')
    assert summary_of(tmp_path / 'file')['row_alignment'] == told
    process(job(bag, tmp_path / 'plain', estimate_rows=False))
    assert summary_of(tmp_path / 'plain')['row_alignment'] is None
    assert contents(tmp_path / 'plain') != contents(tmp_path / 'out')


def test_a_run_that_was_interrupted_goes_on_with_the_alignment_it_began_with(bag, tmp_path, monkeypatch):
    process(job(bag, tmp_path / 'whole'))
    calls = itertools.count()

    def interrupt(_done, _total):
        if next(calls) == COUNT // 2:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        process(job(bag, tmp_path / 'out'), interrupt)
    for options in ({'estimate_rows': False}, {'estimate_rows': False, 'rows': FIELD}):
        with pytest.raises(ValueError, match='begun with a different --align-rows'):
            process(job(bag, tmp_path / 'out', **options))
    monkeypatch.setattr(processing, 'estimate_rows', None)  # would fail if it were called
    process(job(bag, tmp_path / 'out'))
    assert contents(tmp_path / 'out') == contents(tmp_path / 'whole')
    assert summary_of(tmp_path / 'out')['row_alignment'] == summary_of(tmp_path / 'whole')['row_alignment']


def test_a_job_is_the_same_in_another_process(bag, tmp_path):
    given = job(bag, tmp_path / 'out', rows=FIELD)
    assert pickle.loads(pickle.dumps(given)) == given


def test_a_damaged_record_is_refused(bag, tmp_path):
    for wrong in ({'coefficients': [float('1e9')] * 6, 'width': 3, 'height': 3}, {'c': 1}, 3):
        folder = tmp_path / f'{wrong}'[:8]

        def interrupt(_done, _total):
            raise KeyboardInterrupt

        with pytest.raises(KeyboardInterrupt):
            process(job(bag, folder), interrupt)
        metadata = folder.with_name(f'{folder.name}.partial') / 'metadata.yaml'
        text = metadata.read_text()
        before, found, after = text.partition('"rows": ')
        kept, _, rest = after.partition('}')
        assert found and kept
        metadata.write_text(before + found + json.dumps(wrong) + rest)
        with pytest.raises(DamagedBagError, match='damaged'):
            process(job(bag, folder))


def test_aligned_rows_are_left_as_they_are(tmp_path, capsys):
    bag = recorded(tmp_path / 'bag', RowAlignment.identity(WIDTH, HEIGHT), 2)
    assert main([str(bag), str(tmp_path / 'out'), *SET, '--align-rows']) == 0
    assert 'rows: nothing significant to correct' in capsys.readouterr().out
    assert summary_of(tmp_path / 'out')['row_alignment']['coefficients'] == [0] * 6
    process(job(bag, tmp_path / 'plain', estimate_rows=False))
    assert contents(tmp_path / 'plain') == contents(tmp_path / 'out')


def other_focal_length(topic, time_ns, message):
    if topic in (LEFT_INFO, RIGHT_INFO) and time_ns > stamp(2):
        message.p[0] += 10
    return message


def smaller(topic, time_ns, message):
    if 'image' in topic and time_ns > stamp(2):
        return image(message.data.reshape(HEIGHT, WIDTH)[:150], stamp_ns(message))
    return message


@pytest.mark.parametrize('change', [other_focal_length, smaller])
def test_what_changes_within_the_recording_has_no_alignment_and_a_line(tmp_path, change):
    bag = recorded(tmp_path / 'bag', change=change)
    summary = process(job(bag, tmp_path / 'out'))
    assert any('rows are not aligned: the size of the images, or their camera_info, changes' in line
               for line in summary.lines())
    assert summary_of(tmp_path / 'out')['row_alignment'] is None
    assert summary.progress.disparities == COUNT


def test_a_file_for_other_images_and_a_parameter_of_the_node_are_refused(bag, tmp_path, capsys):
    RowAlignment.identity(64, 48).save(tmp_path / 'rows.yaml')
    wrong = dataclasses.replace(FIELD, width=64)
    with pytest.raises(ValueError, match='280 x 200 px cannot be aligned by a row alignment for 64 x 200 px'):
        process(job(bag, tmp_path / 'out', rows=wrong, estimate_rows=False))
    for options, line in ((['--set', 'align_rows=once'], 'it is for the live node; give --align-rows'),
                          (['--align-rows', str(tmp_path / 'none.yaml')], 'none.yaml')):
        assert main([str(bag), str(tmp_path / 'out'), *options]) == 2
        assert line in capsys.readouterr().err
    with pytest.raises(SystemExit):
        main(['--align-rows', str(bag), str(tmp_path / 'out')])
    assert 'must be a .yaml file; without one, write --align-rows last' in capsys.readouterr().err


def test_pairs_are_sampled_evenly_and_the_same_each_time(tmp_path):
    bag = write(tmp_path / 'bag', stereo(20, lambda _: (np.zeros((4, 6), np.uint8),) * 2))
    with open_recording(bag) as recording:
        stream = PairStream(recording, find_stereo_topics(recording.topics), 0, copied=frozenset(),
                            start_ns=recording.start_ns, stop_ns=recording.end_ns)
        whole = [stamp_ns(entry.left.message) for entry in stream if isinstance(entry, RecordedPair)]

        def sampled(most):
            return [stamp_ns(entry.left.message) for entry in stream.sampled(most)]

        assert sampled(100) == whole and len(whole) == 20
        some = sampled(5)
        assert len(some) == 5 and sampled(5) == some and set(np.diff(some)) <= {300_000_000, 400_000_000, 500_000_000}
        assert sampled(1) == whole[:1]
