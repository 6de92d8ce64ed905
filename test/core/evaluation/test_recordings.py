"""What is taken for a recording, and that svdm_core says so where nothing reads it."""
import sys

import pytest

from svdm_core.commands import cli
from svdm_core.evaluation.recordings import is_recording


def test_files_and_folders_of_recordings_are_known(tmp_path):
    for name in ('a.mcap', 'b.db3', 'c.bag', 'd.mcap.zstd', 'drive/e.mcap'):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.touch()
        assert is_recording(path)
    assert is_recording(tmp_path / 'drive')
    (tmp_path / 'images' / 'left').mkdir(parents=True)
    (tmp_path / 'f.png').touch()
    assert not is_recording(tmp_path / 'images') and not is_recording(tmp_path / 'f.png')


def test_without_svdm_ros_one_line_says_so(tmp_path, monkeypatch, capsys):
    pytest.importorskip('rich')
    (tmp_path / 'a.mcap').touch()
    for name in [name for name in sys.modules if name.partition('.')[0] == 'svdm_ros']:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, 'svdm_ros', None)
    assert cli.main(['check-rectification', str(tmp_path / 'a.mcap')]) != 0
    [line] = capsys.readouterr().err.splitlines()
    assert 'a.mcap: recordings are read by svdm_ros, which is not installed: give a folder of images' in line


def test_options_of_recordings_are_refused_for_others(tmp_path, capsys):
    assert cli.main(['check-rectification', str(tmp_path), '--left', '/a']) == 2
    assert 'it is no recording, for which --left, --right and --calib are' in capsys.readouterr().err
