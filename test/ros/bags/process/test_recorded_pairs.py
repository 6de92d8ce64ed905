"""`svdm check-rectification` of recordings."""
import numpy as np
import pytest
from raw_recordings import raw_recording
from recordings import LEFT, RIGHT, stereo, write
from row_scenes import HEIGHT, WIDTH, pair

from svdm_core import RowAlignment
from svdm_core.commands import cli

pytest.importorskip('rich')
FIELD = RowAlignment((0.2, 0, 0, 0.6, 0, 0), WIDTH, HEIGHT)


def check(*arguments):
    return cli.main(['check-rectification', *map(str, arguments)])


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    pairs = [pair('leaves', FIELD, seed) for seed in range(3)]
    return write(tmp_path_factory.mktemp('input') / 'drive', stereo(3, pairs.__getitem__))


def test_a_recording_is_checked_and_its_alignment_written(bag, tmp_path, capsys):
    assert check(bag, '--num-disparities', 24, '-o', tmp_path / 'rows.yaml') == 0
    told = capsys.readouterr().out
    assert 'slightly off: align the rows' in told and 'drive' in told
    rows = RowAlignment.load(tmp_path / 'rows.yaml')
    np.testing.assert_allclose(rows.coefficients, FIELD.coefficients, atol=0.08)
    [file] = bag.glob('*.mcap')
    assert check(file, '--num-disparities', 24, '--left', LEFT, '--right', RIGHT, '--pairs', 1) == 0
    assert 'drive' in capsys.readouterr().out


def test_raw_images_are_rectified_first(tmp_path, capsys):
    bag = raw_recording(tmp_path / 'raw', with_infos=True)
    assert check(bag, '--num-disparities', 32) == 0
    told = capsys.readouterr().out
    assert 'the images are rectified by camera_info first' in told
    assert ' aligned: nothing to do' in told or '\naligned: nothing to do' in told
    assert check(raw_recording(tmp_path / 'plain', with_infos=False), '--num-disparities', 32) == 0
    assert 'not rectified: rectify the images' in capsys.readouterr().out


def test_a_recording_without_a_pair_is_one_line(bag, tmp_path, capsys):
    lone = write(tmp_path / 'lone', [entry for entry in stereo(2) if entry[0] == LEFT])
    for arguments, line in (([lone], 'only one side'), ([bag, '--left', '/a', '--right', '/b'], 'no images on /a')):
        assert check(*arguments) == 2
        [told] = capsys.readouterr().err.splitlines()
        assert line in told and str(arguments[0]) in told
