"""`svdm check-rectification` on files: tables, the alignment, plots, and what is refused."""
import cv2
import numpy as np
import pytest
from row_scenes import HEIGHT, WIDTH, pair
from scene_files import files_of

from svdm_core import RowAlignment
from svdm_core.commands import cli

pytest.importorskip('rich')
FIELD = RowAlignment((0.2, 0, 0, 0.6, 0, 0), WIDTH, HEIGHT)
ALIGNED = RowAlignment.identity(WIDTH, HEIGHT)


def check(*arguments):
    return cli.main(['check-rectification', *map(str, arguments)])


def write(folder, left, right, images):
    for name, image in zip((left, right), images, strict=True):
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / name), image)


@pytest.fixture
def drive(tmp_path):
    folder = tmp_path / 'drive'
    for seed in range(3):
        write(folder, f'left/{seed}.png', f'right/{seed}.png', pair('leaves', FIELD, seed))
    write(folder, 'left/alone.png', 'left/notes.png', pair('leaves', FIELD))
    return folder


def test_a_drive_is_pooled_and_its_alignment_and_plot_are_written(drive, tmp_path, capsys):
    arguments = [drive, '--num-disparities', 24, '-o', tmp_path / 'rows.yaml', '--plot', tmp_path / 'rows.png']
    assert check(*arguments) == 0
    told = capsys.readouterr().out
    assert 'slightly off: align the rows' in told and 'drive' in told
    rows = RowAlignment.load(tmp_path / 'rows.yaml')
    assert f'rows.yaml: {rows.line()}' in told and 'rows.png: offsets and field' in told
    np.testing.assert_allclose(rows.coefficients, FIELD.coefficients, atol=0.08)
    assert rows.points > 500
    assert cv2.imread(str(tmp_path / 'rows.png')).shape[1] == 1100
    assert check(*arguments) == 2 and 'rows.yaml exists already' in capsys.readouterr().err
    assert check(*arguments, '--force', '--pairs', 1) == 0
    assert RowAlignment.load(tmp_path / 'rows.yaml').points < rows.points / 2


def test_two_images_and_their_order(drive, capsys):
    assert check(drive / 'left' / '1.png', drive / 'right' / '1.png') == 0
    assert 'slightly off' in capsys.readouterr().out
    assert check(drive / 'right' / '1.png', drive / 'left' / '1.png') == 0
    assert 'unknown' in capsys.readouterr().out


def test_scenes_have_cameras_of_their_own(tmp_path, capsys):
    for name, field in (('Attic', ALIGNED), ('Barn', FIELD)):
        write(tmp_path / 'data' / name, 'im0.png', 'im1.png', pair('speckles', field))
        (tmp_path / 'data' / name / 'calib.txt').write_text('ndisp=24\n')
    assert check(tmp_path / 'data') == 0
    told = capsys.readouterr().out
    assert 'aligned (Attic): nothing to do' in told and 'slightly off (Barn)' in told
    before = files_of(tmp_path)
    assert check(tmp_path / 'data', '-o', tmp_path / 'a.yaml') == 2
    assert '2 scenes have cameras of their own' in capsys.readouterr().err and files_of(tmp_path) == before
    assert check(tmp_path / 'data' / 'Attic', '-o', tmp_path / 'a.yaml') == 0
    assert 'a.yaml: corrects nothing' in capsys.readouterr().out
    assert RowAlignment.load(tmp_path / 'a.yaml').is_identity


@pytest.mark.parametrize(('arguments', 'words'), [
    (['nowhere'], 'nowhere: there is no such file or folder: give a folder of images, a recording, or a left and a '),
    (['black.png'], 'black.png: one file alone: give a folder of images, a recording, or a left and a right image'),
    (['empty'], 'no pairs in it; expected folders left and right, image_0'), (['halves'], 'no image has the same name'),
    (['drive', '-o', 'a.txt'], "a.txt: the suffix '.txt' is not allowed: it must be .yaml"),
    (['drive', '--plot', 'a.jpg'], "the suffix '.jpg' is not allowed: it must be .png"),
    (['drive', 'drive', 'drive'], '3 places: give a folder of images, a recording, or a left and a right image'),
    (['black.png', 'small.png'], 'images of 30 x 40 and 31 x 40 px'),
    (['black.png', 'black.png', '-o', 'a.yaml'], 'a.yaml is not written, unknown: too few points')])
def test_what_is_wrong_is_said_in_one_line(drive, tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    write(tmp_path, 'black.png', 'small.png', (np.zeros((40, 30), np.uint8), np.zeros((40, 31), np.uint8)))
    write(tmp_path, 'halves/left/a.png', 'halves/right/b.png', pair('leaves', FIELD))
    (tmp_path / 'empty').mkdir()
    before = files_of(tmp_path)
    assert check(*arguments) == 2
    error = capsys.readouterr().err
    assert words in error and len(error.splitlines()) == 1 and files_of(tmp_path) == before


@pytest.mark.parametrize('arguments', [['--num-disparities', '0'], ['--min-disparity', '5000'], ['--pairs', '0'],
                                       ['--min-disparity', 'x']])
def test_numbers_out_of_range_are_refused(drive, capsys, arguments):
    with pytest.raises(SystemExit) as end:
        check(drive, *arguments)
    assert end.value.code == 2 and 'is not allowed' in capsys.readouterr().err
