"""`svdm evaluate` over scenes on disk: the walls of scene_files.py."""
import json
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
import row_scenes
from scene_files import (
    EXACT,
    KITTI,
    SHIFT,
    SIZE,
    evaluate,
    files_of,
    truth_off,
    wall_truth,
    write_kitti,
    write_middlebury,
    write_pfm,
)

from svdm_core import RowAlignment, load_preset
from svdm_core.commands import cli
from svdm_core.evaluation.datasets import MIDDLEBURY_WEIGHTS
from svdm_core.evaluation.metrics import METRICS, weighted_average
from svdm_core.evaluation.paper import PAPER_AVGERR, PAPER_WEIGHTED
from svdm_core.evaluation.scene_evaluation import Answer, Contender

REGIONS = ('nonocc', 'all')
OF_TRUST = ('valid', 'kept', 'kept_wrong')


def document_of(folder, *arguments):
    """What --json writes for scenes that can all be read."""
    path = folder.parent / f'{folder.name}.json'
    assert evaluate(folder, *arguments, '--json', path, '--force') == 0
    return json.loads(path.read_text())


@pytest.fixture
def folder(tmp_path):
    """Two walls; Vintage counts half."""
    write_middlebury(tmp_path / 'data' / 'Attic', truth_off(2, -1))
    write_middlebury(tmp_path / 'data' / 'Vintage', seed=5)
    return tmp_path / 'data'


# Figures


def test_metrics_by_hand_in_full_resolution_px(folder):
    document = document_of(folder)
    assert (document['layout'], document['resolution'], document['pixel_factor']) == ('Middlebury', 'Q', 4)
    attic = document['scenes']['Attic']
    # 84 visible columns of which one is off by 8 px; 90 in all, with another one off by 4 px
    nonocc = {'avgerr': 8 / 84, 'rms': (64 / 84)**0.5, 'bad0.5': 100 / 84, 'bad1': 100 / 84, 'bad2': 100 / 84,
              'bad3': 100 / 84, 'bad4': 100 / 84, 'a50': 0, 'a90': 0, 'a95': 0, 'a99': 8, 'density': 100}
    everywhere = {**nonocc, 'avgerr': 12 / 90, 'rms': (80 / 90)**0.5, 'bad0.5': 200 / 90, 'bad1': 200 / 90,
                  'bad2': 200 / 90, 'bad3': 200 / 90, 'bad4': 100 / 90}
    assert {name: attic[f'{name}_nonocc'] for name in nonocc} == pytest.approx(nonocc)
    assert {name: attic[f'{name}_all'] for name in nonocc} == pytest.approx(everywhere)
    assert attic['valid_nonocc'] == 100 and attic['valid_all'] == pytest.approx(100 * 84 / 90)
    assert attic['num_disparities'] == 16 and attic['time_ms'] > 0 and attic['streaks'] == 0


def test_the_keys_and_the_weighted_average(folder):
    document = document_of(folder)
    keys = {f'{metric}_{region}' for metric in (*METRICS, *OF_TRUST) for region in REGIONS} | {'streaks', 'time_ms'}
    assert set(document['weighted']) == keys
    assert all(set(scene) == keys | {'num_disparities'} for scene in document['scenes'].values())
    assert document['weighted']['avgerr_nonocc'] == pytest.approx(8 / 84 * 1 / 1.5)
    assert document['weighted']['bad4_all'] == pytest.approx(100 / 90 * 1 / 1.5)
    expected = load_preset('default').replace(**EXACT).as_dict()
    del expected['num_disparities']
    assert document['parameters'] == expected and document['method'] == 'svdm'
    assert 'methods' not in document and document['left_out'] == []


@pytest.mark.parametrize(('resolution', 'factor'), [('Q', 4), ('H', 2), ('F', 1)])
def test_errors_grow_with_the_resolution(folder, resolution, factor):
    document = document_of(folder, '--resolution', resolution)
    assert document['scenes']['Attic']['avgerr_nonocc'] == pytest.approx(2 * factor / 84)


@pytest.mark.parametrize('layout', KITTI)
@pytest.mark.parametrize('inside', ['', 'training'])
def test_kitti_by_hand(tmp_path, layout, inside):
    write_kitti(tmp_path / 'kitti', *KITTI[layout], truth=truth_off(3.5, -1))
    document = document_of(tmp_path / 'kitti' / inside, '--set', 'num_disparities=16')
    assert (document['layout'], document['resolution']) == (layout.removesuffix(' grey'), 'F')
    assert list(document['scenes']) == ['000000_10']
    figures = document['scenes']['000000_10']
    assert figures['avgerr_nonocc'] == pytest.approx(3.5 / 84) and figures['avgerr_all'] == pytest.approx(4.5 / 90)
    assert figures['bad3_nonocc'] == pytest.approx(100 / 84) and figures['bad3_all'] == pytest.approx(100 / 90)
    assert figures['bad4_all'] == 0 and figures['num_disparities'] == 16
    assert document['parameters']['num_disparities'] == 16


def test_kitti_searches_the_range_of_its_format_and_has_full_resolution_only(tmp_path, capsys):
    folder = write_kitti(tmp_path, *KITTI['KITTI 2015']) or tmp_path
    assert document_of(folder)['scenes']['000000_10']['num_disparities'] == 256
    assert evaluate(folder, '--resolution', 'Q') == 2
    assert '--resolution Q is not allowed for KITTI 2015' in capsys.readouterr().err


def test_ground_truth_under_its_other_name_and_in_the_other_byte_order(tmp_path):
    write_middlebury(tmp_path / 'data' / 'Attic', truth_name='disp0GT.pfm')
    write_pfm(tmp_path / 'data' / 'Attic' / 'disp0GT.pfm', wall_truth(), scale=1.0)
    assert document_of(tmp_path / 'data')['weighted']['avgerr_all'] == 0
    assert list(document_of(tmp_path / 'data' / 'Attic')['scenes']) == ['Attic']  # a scene is a folder of one


def test_one_of_opencvs_methods_alone(folder):
    document = document_of(folder, '--method', 'bm')
    assert document['method'] == 'bm' and 'methods' not in document
    assert document['parameters'] == {'opencv': cv2.__version__, 'settings': 'StereoBM, block 15'}


def test_methods_side_by_side(folder, capsys):
    document = document_of(folder, '--method', 'svdm,bm', '--method', 'sgbm-hh,svdm', '--scenes', 'Attic')
    table = capsys.readouterr().out
    assert list(document['methods']) == ['svdm', 'bm', 'sgbm-hh'] and document['method'] == 'svdm'
    assert all(name in table for name in document['methods'])
    for method in document['methods'].values():
        assert set(method) == {'parameters', 'scenes', 'weighted', 'confidence'}
        assert method['weighted']['density_all'] == 100
    assert document['methods']['svdm']['weighted']['avgerr_nonocc'] == pytest.approx(8 / 84)
    assert document['methods']['sgbm-hh']['weighted']['a50_all'] < 0.5
    first = {key: document[key] for key in ('parameters', 'scenes', 'weighted', 'confidence')}
    assert first == document['methods']['svdm']
    assert document['methods']['sgbm-hh']['weighted']['valid_all'] < 100


def test_what_is_kept_and_what_is_wrong_of_it_by_hand(folder, capsys):
    document = document_of(folder, '--method', 'svdm,bm', '--scenes', 'Attic', '--metrics', 'kept', 'kept_wrong')
    output = capsys.readouterr().out
    assert 'kept_wrong' in output and 'by confidence: 1.1 % of the' in output
    svdm, bm = (method['confidence'] for method in document['methods'].values())
    # One visible column of 84 is off by 2 px of the images; of 90 in all none of the others by more than 1 px.
    for region, columns in (('nonocc', 84), ('all', 90)):
        assert svdm[region]['wrong_by_1px']['wrong'][-1] == pytest.approx(100 / columns)
        assert svdm[region]['wrong_by_2px']['wrong'] == [0] * 100 and svdm[region]['wrong_by_2px']['auc'] is None
        assert svdm[region]['wrong_by_1px']['own_check']['wrong'] == pytest.approx(100 / 84)
        assert set(bm[region]['wrong_by_1px']) == {'own_check'} and 'reliability' not in bm[region]
    figures = document['methods']['svdm']['scenes']['Attic']
    assert figures['kept_nonocc'] > 99 and figures['kept_wrong_nonocc'] == pytest.approx(100 / 84, rel=0.01)
    assert svdm['all']['wrong_by_1px']['own_check']['kept'] == pytest.approx(figures['valid_all'])
    bm_figures = document['methods']['bm']['scenes']['Attic']
    assert bm_figures['kept_all'] == bm_figures['valid_all'] < 100


def test_the_constants_are_fitted_and_told(folder, capsys):
    document = document_of(folder, '--fit-confidence')
    found, output = document['confidence_fit'], capsys.readouterr().out
    assert f'1 / (1 + exp({found["slope"]:.3f} c - {found["offset"]:.3f}))' in output and '(Attic)' in output
    assert set(found['scenes']) == {'Attic', 'Vintage'}
    # No pixel of Vintage is wrong: only its constants, fitted to Attic alone, have anything to tell.
    assert found['scenes']['Vintage']['auc'] is None and found['left_out']['auc_worst_scene'] == 'Attic'
    assert found['left_out']['wrong']['100'] == pytest.approx(100 / 90 / 2)
    assert document_of(folder)['confidence_fit'] is None


def test_grey_takes_the_colour_away(folder, monkeypatch):
    seen = []

    def match(_self, scene, _num_disparities):
        seen.append(scene.left.ndim)
        return Answer(np.full(SIZE, SHIFT, np.float32), np.ones(SIZE, bool), None)

    monkeypatch.setattr(Contender, '_match', match)
    assert document_of(folder, '--grey')['grey'] is True and document_of(folder)['grey'] is False
    assert seen == [2, 2, 3, 3]


def test_the_table_has_the_metrics_asked_for(folder, capsys):
    assert evaluate(folder, '--metrics', 'bad3', 'valid') == 0
    output = capsys.readouterr().out
    assert 'bad3' in output and 'valid' in output and 'avgerr' not in output
    assert '1.2' in output and '0.8' in output  # bad3_nonocc of Attic, and weighted


def test_the_papers_table_is_copied_right():
    assert list(PAPER_AVGERR) == sorted(PAPER_AVGERR) and len(PAPER_AVGERR) == 15
    assert weighted_average(PAPER_AVGERR, MIDDLEBURY_WEIGHTS) == pytest.approx(PAPER_WEIGHTED, abs=0.05)


# What is wrong


def test_a_broken_scene_is_named_and_the_others_go_on(folder, tmp_path, capsys):
    write_middlebury(folder / 'Broken')
    (folder / 'Broken' / 'im1.png').unlink()
    path = tmp_path / 'a.json'
    assert evaluate(folder, '--json', path, '--html', tmp_path / 'a.html') == 1
    captured = capsys.readouterr()
    error = captured.err.splitlines()
    assert len(error) == 1 and error[0].startswith('svdm evaluate: left out: ')
    assert error[0].endswith('im1.png: there is no such file')
    document = json.loads(path.read_text())
    assert list(document['scenes']) == ['Attic', 'Vintage'] and len(document['left_out']) == 1
    assert 'im1.png: there is no such file' in (tmp_path / 'a.html').read_text()


def _swap_bytes(scene):
    path = scene / 'disp0.pfm'
    path.write_bytes(path.read_bytes().replace(b'\n-1.0\n', b'\n1.0\n', 1))


def _truncate(scene):
    path = scene / 'disp0.pfm'
    path.write_bytes(path.read_bytes()[:-8])


@pytest.mark.parametrize(('spoil', 'words'), [
    (lambda scene: write_pfm(scene / 'disp0.pfm', wall_truth()[:, 1:]),
     'Attic: the sizes differ: left image 90 x 40, right image 90 x 40, ground truth 89 x 40, mask 90 x 40'),
    (_swap_bytes, 'not within the 90 px of the image: wrong byte order?'),
    (lambda scene: write_pfm(scene / 'disp0.pfm', wall_truth(-1.0)), 'ground truth from -1 to -1 px, not within'),
    (_truncate, 'disp0.pfm: 14392 bytes of data where 90 x 40 pixels take 14400'),
    (lambda scene: (scene / 'disp0.pfm').write_bytes(b'Pf\n-90 -40\n-1\n' + bytes(14400)), 'a PFM of -90 x -40 pixels'),
    (lambda scene: (scene / 'disp0.pfm').write_bytes(b'Pf\n90 40\nnan\n' + bytes(14400)), 'with scale nan'),
    (lambda scene: (scene / 'disp0.pfm').unlink(), 'Attic: no disp0.pfm nor disp0GT.pfm in it'),
    (lambda scene: (scene / 'calib.txt').unlink(), 'calib.txt'),
    (lambda scene: (scene / 'calib.txt').write_text('ndisp=0\n'), 'calib.txt: no line ndisp='),
    (lambda scene: (scene / 'calib.txt').write_text('ndisp=5000\n'), 'num_disparities = 5000 is not allowed'),
    (lambda scene: (scene / 'mask0nocc.png').unlink(), 'mask0nocc.png: there is no such file'),
    (lambda scene: write_pfm(scene / 'disp0.pfm', np.full(SIZE, np.inf)), 'no visible pixel has known ground truth'),
    (lambda scene: cv2.imwrite(str(scene / 'mask0nocc.png'), np.zeros(SIZE)), 'no visible pixel has known ground'),
])
def test_a_scene_that_is_wrong_leaves_nothing_to_evaluate(tmp_path, capsys, spoil, words):
    spoil(write_middlebury(tmp_path / 'data' / 'Attic'))
    assert_refused(tmp_path, capsys, words, '--json', tmp_path / 'a.json')


def assert_refused(tmp_path, capsys, words, *arguments):
    """Exit code 2, one line with `words`, no file written or changed."""
    before = files_of(tmp_path)
    assert evaluate(tmp_path / 'data', *arguments) == 2
    error = capsys.readouterr().err.splitlines()
    assert len(error) == 1 and error[0].startswith('svdm evaluate: ') and words in error[0], error
    assert files_of(tmp_path) == before


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--scenes', 'Attic', 'Cellar'], "there is no scene 'Cellar'; there are Attic, Vintage"),
    (['--method', 'svdm,sgm'], "method 'sgm' is not allowed: it must be svdm | bm | sgbm-3way | sgbm-hh4 | sgbm-hh"),
    (['--method', ''], "method '' is not allowed"),
    (['--fit-confidence', '--scenes', 'Attic'], '--fit-confidence needs two scenes or more, to leave one out'),
    (['--fit-confidence', '--method', 'bm'], '--fit-confidence needs svdm among the methods'),
    (['--metrics', 'bad7'], "metric 'bad7' is not allowed: it must be avgerr | rms"),
    (['--set', 'alpha=-1'], 'alpha = -1.0 is not allowed: it must be a number, 0.0 to 1000.0'),
    (['--set', 'alfa=1'], 'did you mean alpha?'),
    (['--preset', 'papier'], "no preset 'papier'"),
    (['--json', 'nowhere/a.json'], 'there is no folder nowhere'),
    (['--html', 'taken.html'], 'taken.html exists already: remove it, name another file, or give --force'),
    (['--json', 'a', '--html', 'a'], 'a is named twice'),
])
def test_wrong_arguments_are_said_in_one_line(folder, tmp_path, monkeypatch, capsys, arguments, words):
    monkeypatch.chdir(tmp_path)
    (tmp_path / 'taken.html').write_text('mine')
    assert_refused(tmp_path, capsys, words, *arguments)


def test_a_folder_without_scenes_is_told_what_was_looked_for(tmp_path, capsys):
    assert_refused(tmp_path, capsys, 'there is no such folder')
    (tmp_path / 'data').mkdir()
    assert_refused(tmp_path, capsys, 'no scene in it; expected folders with im0.png')
    (tmp_path / 'data' / 'image_2').mkdir()
    (tmp_path / 'data' / 'disp_occ_0').mkdir()
    assert_refused(tmp_path, capsys, 'disp_occ_0: no ground truth in it')


def test_kitti_truth_of_another_kind_is_named(tmp_path, capsys):
    parts = KITTI['KITTI 2015']
    write_kitti(tmp_path / 'data', *parts)
    wrong = tmp_path / 'data' / 'training' / 'disp_occ_0' / '000000_10.png'
    cv2.imwrite(str(wrong), np.full(SIZE, 6, np.uint8))
    assert_refused(tmp_path, capsys, 'ground truth is a grey PNG of 16 bit')
    cv2.imwrite(str(wrong), np.full((40, 80), 1536, np.uint16))
    assert_refused(tmp_path, capsys, 'disp_noc_0 has 90 x 40 pixels, disp_occ_0 80 x 40')


def test_a_figure_that_is_no_number_ends_the_run(folder, tmp_path, monkeypatch, capsys):
    nothing = Answer(np.full(SIZE, np.nan, np.float32), np.ones(SIZE, bool), None)
    monkeypatch.setattr(Contender, '_match', lambda *_: nothing)
    assert_refused(tmp_path, capsys, 'svdm on Attic: avgerr_nonocc is nan', '--json', tmp_path / 'a.json')


def test_what_opencv_cannot_match_is_named(tmp_path, capsys):
    write_middlebury(tmp_path / 'data' / 'Attic')
    for name in ('im0', 'im1', 'mask0nocc'):
        path = str(tmp_path / 'data' / 'Attic' / f'{name}.png')
        cv2.imwrite(path, cv2.imread(path)[:4])
    write_pfm(tmp_path / 'data' / 'Attic' / 'disp0.pfm', wall_truth()[:4])
    assert_refused(tmp_path, capsys, 'Attic: bm cannot match it', '--method', 'bm')


def test_force_overwrites_and_nothing_else_does(folder, tmp_path, capsys):
    path = tmp_path / 'a.json'
    path.write_text('mine')
    assert_refused(tmp_path, capsys, 'a.json exists already', '--json', path)
    assert evaluate(folder, '--json', path, '--force') == 0 and 'weighted' in json.loads(path.read_text())


# Real images


def test_a_real_scene_beside_opencv(tmp_path):
    folder = Path(os.environ.get('SVDM_DATA', 'unset')) / 'middlebury_v3_trainingQ'
    if not folder.is_dir():
        pytest.skip('SVDM_DATA names no folder with middlebury_v3_trainingQ')
    path = tmp_path / 'a.json'
    arguments = [str(folder), '--scenes', 'Teddy', '--method', 'svdm,sgbm-hh', '--json', str(path)]
    assert cli.main(['evaluate', *arguments]) == 0
    svdm, sgbm = (method['weighted'] for method in json.loads(path.read_text())['methods'].values())
    assert 3 < sgbm['avgerr_nonocc'] < 4 and 4.5 < sgbm['avgerr_all'] < 5.5  # measured 3.50 and 4.89
    for metric in ('avgerr', 'bad2', 'bad4'):
        for region in REGIONS:
            assert svdm[f'{metric}_{region}'] < 0.8 * sgbm[f'{metric}_{region}']


# Rows


def _scene_off(folder, field):
    write_middlebury(folder)
    left, right = row_scenes.pair('slanted speckles', field)
    for name, image in (('im0', left), ('im1', right), ('mask0nocc', np.full_like(left, 255))):
        cv2.imwrite(str(folder / f'{name}.png'), image)
    write_pfm(folder / 'disp0.pfm', row_scenes.truth('slanted speckles').astype(np.float32))
    (folder / 'calib.txt').write_text('ndisp=24\n')


def test_rows_are_aligned_and_that_is_told_everywhere(tmp_path, capsys):
    field = RowAlignment((0.9, 0, 0, 0.9, 0, 0), row_scenes.WIDTH, row_scenes.HEIGHT)
    _scene_off(tmp_path / 'data' / 'Attic', field)
    _scene_off(tmp_path / 'data' / 'Barn', RowAlignment.identity(row_scenes.WIDTH, row_scenes.HEIGHT))
    as_they_are = document_of(tmp_path / 'data')
    capsys.readouterr()
    document = document_of(tmp_path / 'data', '--align-rows', '--html', tmp_path / 'a.html')
    assert as_they_are['row_alignment'] is None and document['row_alignment']['Barn'] is None
    np.testing.assert_allclose(document['row_alignment']['Attic']['coefficients'], field.coefficients, atol=0.1)
    told = 'rows aligned in 1 of 2 scenes'
    page = (tmp_path / 'a.html').read_text()
    assert told in capsys.readouterr().out and told in page and 'colour as the files have it, rows aligned.' in page
    errors, before = (one['scenes']['Attic']['avgerr_nonocc'] for one in (document, as_they_are))
    assert errors < 0.9 * before  # measured 4.17 and 5.16 px
    assert document['scenes']['Barn']['avgerr_nonocc'] == as_they_are['scenes']['Barn']['avgerr_nonocc']
