import json

import cv2
import pytest
from scenes import noise

from svdm_core import preset_names
from svdm_core.benchmark.runs import contender_names
from svdm_core.commands import cli


def test_the_command_writes_the_figures_and_overwrites_nothing(tmp_path, capsys):
    path, picture = tmp_path / 'figures.json', tmp_path / 'figures.png'
    arguments = ['benchmark', '--size', '160x120', '--disparities', '16', '--rounds', '1', '--threads', '1',
                 '--json', str(path), '--png', str(picture)]
    assert cli.main(arguments) == 0
    table = capsys.readouterr().out
    document = json.loads(path.read_text())
    assert list(document['contenders']) == contender_names(preset_names())
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
    (['--disparities', '-4'], "num_disparities = -4 is not allowed"),
])
def test_wrong_arguments_are_named(arguments, words, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(['benchmark', *arguments])
    assert end.value.code == 2 and words in capsys.readouterr().err


def test_images_that_do_not_fit_are_named(tmp_path, capsys):
    cv2.imwrite(str(tmp_path / 'a.png'), noise(5, 6))
    cv2.imwrite(str(tmp_path / 'b.png'), noise(5, 7))
    for right, words in (('nowhere.png', 'missing, or not an image'), ('b.png', 'different sizes: (5, 6) and (5, 7)')):
        assert cli.main(['benchmark', '--pair', str(tmp_path / 'a.png'), str(tmp_path / right)]) == 2
        assert words in capsys.readouterr().err
