import json
import sys

import cv2
import pytest
from scenes import noise

from svdm_core.benchmark.contenders import all_methods, contender_names
from svdm_core.commands import cli


def test_the_command_writes_the_figures_and_overwrites_nothing(tmp_path, capsys):
    path, picture = tmp_path / 'figures.json', tmp_path / 'figures.png'
    arguments = ['benchmark', '--size', '160x120', '--rounds', '1', '--threads', '1',
                 '--json', str(path), '--png', str(picture)]
    assert cli.main(arguments) == 0
    table = capsys.readouterr().out
    document = json.loads(path.read_text())
    assert list(document['contenders']) == contender_names(all_methods())
    for name, value in document['contenders'].items():
        assert {'median_ms', 'stages_ms', 'extra_mb', 'avgerr'} <= set(value)
        assert name in table
    assert document['contenders']['svdm-default']['extra_mb'] > 1
    assert cv2.imread(str(picture)) is not None
    before = path.read_bytes()
    assert cli.main(arguments) == 2
    assert 'figures.json exists already' in capsys.readouterr().err and path.read_bytes() == before


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--size', '640'], "'640' is not a size"),
    (['--size', '0x480'], "'0x480' is not a size"),
    (['--threads', '0'], "'0' is not allowed: it must be an integer from 1 up"),
    (['--model-threads', '0'], "'0' is not allowed: it must be integers from 1 to 1024, separated by commas"),
    (['--model-threads', '1,1000000'], "'1000000' is not allowed: it must be integers from 1 to 1024"),
    (['--model-threads', '1,,2'], "'' is not allowed: it must be integers from 1 to 1024"),
    (['--disparities', '-4'], "num_disparities = -4 is not allowed"),
])
def test_wrong_arguments_are_named(arguments, words, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(['benchmark', *arguments])
    assert end.value.code == 2 and words in capsys.readouterr().err


def test_images_that_do_not_fit_are_named(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / 'a.png'), noise(5, 6))
    cv2.imwrite(str(tmp_path / 'b.png'), noise(5, 7))
    for right, words in (('nowhere.png', 'nowhere.png: there is no such file'),
                         ('b.png', 'different sizes: (5, 6) and (5, 7)')):
        assert cli.main(['benchmark', '--pair', str(tmp_path / 'a.png'), str(tmp_path / right)]) == 2
        assert words in capsys.readouterr().err


SMALL = ['benchmark', '--size', '160x120', '--rounds', '2', '--threads', '1']


def test_methods_are_chosen_and_modelled(tmp_path, capsys):
    (tmp_path / 'my.yaml').write_text('/**:\n  ros__parameters:\n    right_rows: 3\n')
    own, path, picture = str(tmp_path / 'my.yaml'), tmp_path / 'figures.json', tmp_path / 'model.png'
    assert cli.main([*SMALL, '--methods', f'paper,fast,{own},sgbm-hh', '--model-threads', '16,1,4',
                     '--json', str(path), '--plot', str(picture)]) == 0
    document = json.loads(path.read_text())
    works = {name: value['work'] for name, value in document['contenders'].items()}
    assert works == {'svdm-paper': 'no paths, 2 views', 'svdm-fast': '3 paths, 1.5 views', own: '4 paths, 1.33 views',
                     'sgbm-hh': '8 paths, 1 view'}
    model = document['model']
    assert list(model) == ['svdm-paper', 'svdm-fast', own] and 'two tasks' in model['svdm-paper']['not_modelled']
    for name in ('svdm-fast', own):
        rows, phases = model[name]['rows'], model[name]['phases']
        assert [row['threads'] for row in rows] == [1, 4, 16]
        assert rows[0]['speed_up'] == 1 and rows[0]['measured_ms'] > 0
        total = model[name]['serial_ms'] + sum(phase['entry_ms'] + sum(phase['tasks_ms']) for phase in phases)
        assert rows[0]['ms'] == pytest.approx(total)
        assert {phase['stage'] for phase in phases} >= {'matching_cost', 'disparity_refinement'}
    assert cv2.imread(str(picture)) is not None
    out = capsys.readouterr().out
    assert 'svdm-paper is not modelled: its trees' in out and 'speed-up' in out and '3 paths, 1.5 views' in out


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--methods', 'fast,fats'], "method 'fats' is not allowed: it must be one of accurate, default, fast"),
    (['--methods', 'nowhere.yaml'], "method 'nowhere.yaml' is not allowed"),
    (['--methods', ''], "method '' is not allowed"),
    (['--plot', 'model.png'], '--plot draws the model: give --model-threads as well'),
    (['--model-threads', '2', '--plot', 'model.txt'], "model.txt: the suffix '.txt' is not allowed"),
    (['--model-threads', '2', '--methods', 'paper,bm'], 'none of --methods can be modelled'),
    (['--scaling', '--methods', 'bm'], '--methods names none'),
])
def test_what_makes_no_sense_is_refused_in_one_line(arguments, words, capsys):
    assert cli.main([*SMALL, *arguments]) == 2
    error = capsys.readouterr().err
    assert words in error and error.count('\n') == 1


def test_a_plot_is_refused_before_the_work(tmp_path, capsys, monkeypatch):
    picture = tmp_path / 'model.png'
    picture.write_bytes(b'mine')
    arguments = [*SMALL, '--model-threads', '2', '--plot', str(picture)]
    assert cli.main(arguments) == 2
    assert 'model.png exists already' in capsys.readouterr().err and picture.read_bytes() == b'mine'
    monkeypatch.setitem(sys.modules, 'matplotlib.backend_bases', None)
    assert cli.main([*arguments, '--force']) == 2
    assert 'matplotlib is not installed' in capsys.readouterr().err and picture.read_bytes() == b'mine'
