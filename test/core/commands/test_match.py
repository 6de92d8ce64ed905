import cv2
import numpy as np
import pytest
from row_scenes import HEIGHT, WIDTH
from row_scenes import pair as pair_with_rows
from scene_files import files_of
from scenes import noise, shifted_wall

from svdm_core import RowAlignment, StereoMatcher, estimate_row_alignment, load_preset, preset_names
from svdm_core.commands import cli
from svdm_core.files.disparity_files import encode_disparity
from svdm_core.files.pfm import read_pfm
from svdm_core.presets import preset_folder

SHIFT = 7
ROWS = RowAlignment((0.5, 0, 0, 0.7, 0, 0), WIDTH, HEIGHT)
SETTINGS = ['--set', 'num_disparities=16', '--threads', '1']


@pytest.fixture
def pair(tmp_path):
    paths = [tmp_path / 'left.png', tmp_path / 'right.png']
    for path, image in zip(paths, shifted_wall(40, 90, SHIFT), strict=True):
        cv2.imwrite(str(path), image)
    return [str(path) for path in paths]


def match(pair, *arguments):
    return cli.main(['match', *pair, *SETTINGS, *map(str, arguments)])


def expected(**changes):
    left, right = shifted_wall(40, 90, SHIFT)
    return StereoMatcher(load_preset('default').replace(num_disparities=16, **changes), 1).compute(left, right)


def test_each_format_holds_the_disparity_and_a_picture_lies_beside_it(pair, tmp_path, capsys):
    for suffix in ('pfm', 'png', 'npy'):
        assert match(pair, '-o', tmp_path / f'a.{suffix}', '--preview', tmp_path / f'{suffix}.png') == 0
    disparity = expected().disparity
    np.testing.assert_array_equal(read_pfm(tmp_path / 'a.pfm'), disparity)
    np.testing.assert_array_equal(np.load(tmp_path / 'a.npy'), disparity)
    steps = cv2.imread(str(tmp_path / 'a.png'), cv2.IMREAD_UNCHANGED)
    assert steps.dtype == np.uint16
    assert (np.abs(steps / 256 - disparity) <= np.maximum(1 / 512, 1 / 256 - disparity)).all()
    assert np.median(disparity) == pytest.approx(SHIFT, abs=0.2)
    assert cv2.imread(str(tmp_path / 'npy.png'), cv2.IMREAD_UNCHANGED).shape == (40, 90, 3)
    assert '% are valid' in capsys.readouterr().out


def test_without_names_the_files_lie_in_the_current_folder(pair, tmp_path, monkeypatch):
    (tmp_path / 'here').mkdir()
    monkeypatch.chdir(tmp_path / 'here')
    assert match(pair) == 0
    assert sorted(path.name for path in (tmp_path / 'here').iterdir()) == ['disparity.pfm', 'disparity_preview.png']


def test_valid_only_leaves_out_what_fails_the_check(pair, tmp_path):
    assert match(pair, '-o', tmp_path / 'a.pfm', '--valid-only') == 0
    assert match(pair, '-o', tmp_path / 'a.png', '--valid-only', '--force') == 0
    valid = expected().valid
    assert not valid.all()
    np.testing.assert_array_equal(np.isfinite(read_pfm(tmp_path / 'a.pfm')), valid)
    np.testing.assert_array_equal(cv2.imread(str(tmp_path / 'a.png'), cv2.IMREAD_UNCHANGED) > 0, valid)
    assert (cv2.imread(str(tmp_path / 'a_preview.png'))[~valid] == 0).all()


def test_kittis_steps_by_hand(tmp_path):
    values = np.array([[0.0, 1.5, 255.99, np.inf, np.nan]], np.float32)
    png = encode_disparity(values, tmp_path / 'a.png')
    steps = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_UNCHANGED)
    assert steps.tolist() == [[1, 384, 65533, 0, 0]]
    with pytest.raises(ValueError, match=r'a\.png: disparities up to 256 px do not fit a 16-bit PNG'):
        encode_disparity(values + 0.01, tmp_path / 'a.png')


def test_parameters_come_from_preset_file_and_set(pair, tmp_path):
    assert match(pair, '-o', tmp_path / 'a.npy', '--preset', 'paper', '--set', 'subpixel=true') == 0
    assert match(pair, '-o', tmp_path / 'b.npy', '--params', preset_folder() / 'paper.yaml', '--set',
                 'subpixel=TRUE', 'w_p=31') == 0
    left, right = shifted_wall(40, 90, SHIFT)
    paper = load_preset('paper').replace(num_disparities=16, subpixel=True)
    expected = StereoMatcher(paper).compute(left, right).disparity
    for name in 'ab':
        np.testing.assert_array_equal(np.load(tmp_path / f'{name}.npy'), expected)


def test_sixteen_bit_and_colour_images_are_taken_as_they_are(tmp_path):
    left, right = (cv2.merge([image] * 3).astype(np.uint16) * 257 for image in shifted_wall(30, 60, 5))
    for name, image in (('l.png', left), ('r.png', right)):
        cv2.imwrite(str(tmp_path / name), image)
    assert match([str(tmp_path / 'l.png'), str(tmp_path / 'r.png')], '-o', tmp_path / 'a.npy') == 0
    matcher = StereoMatcher(load_preset('default').replace(num_disparities=16), 1)
    np.testing.assert_array_equal(np.load(tmp_path / 'a.npy'), matcher.compute(left, right).disparity)


def test_nothing_is_overwritten_without_force(pair, tmp_path, capsys):
    for taken in ('a.pfm', 'a_preview.png'):
        (tmp_path / taken).write_text('mine')
        before = files_of(tmp_path)
        assert match(pair, '-o', tmp_path / 'a.pfm') == 2
        assert f'{taken} exists already' in capsys.readouterr().err and files_of(tmp_path) == before
        (tmp_path / taken).unlink()
    (tmp_path / 'a.pfm').write_text('mine')
    assert match(pair, '-o', tmp_path / 'a.pfm', '--force') == 0
    assert read_pfm(tmp_path / 'a.pfm').shape == (40, 90)


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--set', 'alpha=-1'], 'alpha = -1.0 is not allowed: it must be a number, 0.0 to 1000.0'),
    (['--set', 'alpha=nan'], "alpha = 'nan' is not allowed"),
    (['--set', 'w_p=30'], 'w_p = 30 is not allowed: it must be an integer, 1, 3 ... 101 px'),
    (['--set', 'subpixel=1'], "subpixel = '1' is not allowed: it must be true | false"),
    (['--set', 'paths=five'], "paths = 'five' is not allowed: it must be an integer, 3 to 4"),
    (['--set', 'gradient=vertical'], "gradient = 'vertical' is not allowed: it must be horizontal | magnitude"),
    (['--set', 'alfa=1'], "unknown parameter 'alfa': did you mean alpha?"),
    (['--set', 'alpha'], '--set alpha is not allowed: write it as name=value'),
    (['--preset', 'papier'], f"no preset 'papier': there are {', '.join(preset_names())}"),
    (['--params', 'nowhere.yaml'], "no preset 'nowhere.yaml'"),
    (['-o', 'a.tif'], "a.tif: the suffix '.tif' is not allowed: it must be .pfm | .png | .npy"),
    (['-o', 'a'], "the suffix '' is not allowed"),
    (['--preview', 'a.jpg'], "a.jpg: the suffix '.jpg' is not allowed: a preview is a .png"),
    (['-o', 'nowhere/a.pfm'], 'there is no folder nowhere'),
    (['-o', 'a.png', '--preview', './a.png'], 'a.png is named twice'),
    (['-o', 'folder.pfm'], 'folder.pfm is a folder'),
])
def test_what_is_wrong_is_said_in_one_line_and_nothing_written(pair, tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'folder.pfm').mkdir()
    before = files_of(tmp_path)
    assert match(pair, *arguments) == 2
    error = capsys.readouterr().err
    assert words in error and len(error.splitlines()) == 1
    assert files_of(tmp_path) == before


def test_preset_and_params_exclude_each_other(pair, capsys):
    with pytest.raises(SystemExit) as end:
        match(pair, '--preset', 'paper', '--params', 'a.yaml')
    assert end.value.code == 2 and 'not allowed with' in capsys.readouterr().err


def test_images_that_do_not_fit_are_named(pair, tmp_path, capfd):
    cv2.imwrite(str(tmp_path / 'small.png'), noise(5, 6))
    (tmp_path / 'text.png').write_text('no image')
    (tmp_path / 'cut.png').write_bytes((tmp_path / 'left.png').read_bytes()[:-1000])
    for right, words in (('nowhere.png', 'nowhere.png: there is no such file'),
                         ('text.png', 'text.png: not an image of PNG'), ('cut.png', 'cut.png: a truncated PNG'),
                         ('small.png', 'must have the same shape')):
        assert match([pair[0], str(tmp_path / right)], '-o', tmp_path / 'a.pfm') == 2
        error = capfd.readouterr().err
        assert words in error and len(error.splitlines()) == 1, error
    assert not (tmp_path / 'a.pfm').exists()


def test_a_full_disk_leaves_nothing_behind(pair, tmp_path, monkeypatch, capsys):
    (tmp_path / 'a.pfm').write_text('mine')
    before = files_of(tmp_path)

    def full(*_args, **_kwargs):
        raise OSError(28, 'No space left on device')

    monkeypatch.setattr('svdm_core.files.output_files.os.fchmod', full)
    assert match(pair, '-o', tmp_path / 'a.pfm', '--force') == 2
    assert 'a.pfm: cannot be written: No space left on device' in capsys.readouterr().err
    assert files_of(tmp_path) == before


# Rows


@pytest.fixture
def misaligned(tmp_path):
    write_pair(tmp_path, *pair_with_rows('leaves', ROWS))
    return [str(tmp_path / name) for name in ('left.png', 'right.png')]


def write_pair(folder, left, right):
    for name, image in (('left.png', left), ('right.png', right)):
        cv2.imwrite(str(folder / name), image)


def test_rows_are_aligned_by_what_the_pair_shows_or_by_a_file(misaligned, tmp_path, capsys):
    left, right = pair_with_rows('leaves', ROWS)
    matcher = StereoMatcher(load_preset('fast').replace(num_disparities=24), 1)
    arguments = ['match', *misaligned, '--preset', 'fast', '--set', 'num_disparities=24', '-o', str(tmp_path / 'a.npy')]
    assert cli.main([*arguments, '--align-rows']) == 0
    rows = estimate_row_alignment((left, right), 0, 24)
    np.testing.assert_array_equal(np.load(tmp_path / 'a.npy'), matcher.compute(left, right, rows).disparity)
    assert f'rows aligned: {rows.line()}' in capsys.readouterr().out
    ROWS.save(tmp_path / 'rows.yaml')
    assert cli.main([*arguments, '--align-rows', str(tmp_path / 'rows.yaml'), '--force']) == 0
    np.testing.assert_array_equal(np.load(tmp_path / 'a.npy'), matcher.compute(left, right, ROWS).disparity)
    assert f'rows aligned by {tmp_path / "rows.yaml"}: {ROWS.line()}' in capsys.readouterr().out


def test_aligned_rows_are_said_to_be(tmp_path, capsys):
    write_pair(tmp_path, *pair_with_rows('leaves', RowAlignment.identity(ROWS.width, ROWS.height)))
    images = [str(tmp_path / name) for name in ('left.png', 'right.png')]
    assert match(images, '-o', tmp_path / 'a.npy', '--align-rows') == 0
    assert 'rows: nothing significant to correct' in capsys.readouterr().out


def test_an_alignment_that_does_not_fit_is_refused_in_one_line(pair, tmp_path, capsys):
    ROWS.save(tmp_path / 'rows.yaml')
    (tmp_path / 'bad.yaml').write_text('width: 3')
    for name, words in (('rows.yaml', 'cannot be aligned by a row alignment for 280 x 200 px'),
                        ('bad.yaml', 'bad.yaml: no row alignment'), ('none.yaml', 'there is no such file')):
        assert match(pair, '-o', tmp_path / 'a.pfm', '--align-rows', tmp_path / name) == 2
        out, error = capsys.readouterr()
        assert words in error and len(error.splitlines()) == 1 and out == ''
    assert not (tmp_path / 'a.pfm').exists()
    with pytest.raises(SystemExit):
        cli.main(['match', '--align-rows', *pair])
    assert 'write --align-rows last' in capsys.readouterr().err
