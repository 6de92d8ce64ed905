import json

import cv2
import numpy as np
import pytest
from scenes import noise, shifted_wall

from svdm_core import preset_names
from svdm_core.benchmark.runs import BenchmarkPair, contender_names, growth, ratios, run_benchmark
from svdm_core.commands import cli
from svdm_core.evaluation.opencv_matchers import OPENCV_METHODS, OpenCVMatcher


@pytest.mark.parametrize('method', OPENCV_METHODS)
@pytest.mark.parametrize('colour', [False, True])
def test_opencv_finds_a_flat_wall_and_its_dense_map_has_no_holes(method, colour):
    left, right = shifted_wall(60, 120, 9)
    if colour:
        left, right = (np.ascontiguousarray(np.repeat(image[..., None], 3, axis=2)) for image in (left, right))
    matcher = OpenCVMatcher(method, 20, 3 if colour else 1)
    inside = np.s_[10:-10, 45:-10]
    assert np.median(matcher.compute(left, right)[inside]) == pytest.approx(9, abs=0.1)
    dense = matcher.compute_dense(left, right)
    assert dense.shape == (60, 120) and dense.dtype == np.float32 and dense.min() >= 0
    assert (np.abs(dense[inside] - 9) < 0.5).mean() > 0.99


def test_an_unknown_method_is_named():
    with pytest.raises(ValueError, match="method = 'sgm' is not allowed: it must be bm"):
        OpenCVMatcher('sgm', 16, 1)


def test_a_scaled_pair_keeps_its_truth():
    truth = np.full((40, 80), 12, np.float32)
    truth[:, :8] = np.inf
    pair = BenchmarkPair(noise(40, 80, 3), noise(40, 80, 3), truth).scaled(40, 20).grey()
    assert pair.left.shape == (20, 40) == pair.ground_truth.shape
    assert (pair.ground_truth[:, 4:] == 6).all() and np.isinf(pair.ground_truth[:, :4]).all()


def test_every_contender_is_timed_and_judged():
    left, right = shifted_wall(48, 100, 6)
    pair = BenchmarkPair(left, right, np.full((48, 100), 6, np.float32))
    rounds = []
    names = ['svdm-default', 'bm']
    figures = run_benchmark(pair, names, 16, 1, 3, lambda: rounds.append(1), memory=False)
    assert list(figures) == names and len(rounds) == 3
    for name, value in figures.items():
        assert 0 < value['low_ms'] <= value['median_ms'] <= value['high_ms']
        assert value['mde_per_s'] == pytest.approx(48 * 100 * 16 / 1e3 / value['median_ms'])
        assert value['bad2'] < 40  # BM has no answer near the border
        assert bool(value['stages_ms']) == name.startswith('svdm-')
    ratio = ratios(figures)
    assert ratio['bm'] == {'bm': 1.0}
    assert ratio['svdm-default']['bm'] == figures['svdm-default']['median_ms'] / figures['bm']['median_ms']


def test_growth_is_the_exponent():
    assert growth([1, 2, 4, 8], [3 * n**1.3 for n in (1, 2, 4, 8)]) == pytest.approx(1.3)


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
