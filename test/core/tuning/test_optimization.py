"""Studies, what they keep and what they find, on made scenes and on those of the paper."""
import numpy as np
import pytest
from tuning_scenes import real_scenes, write_scenes

from svdm_core import MatcherParameters, StereoMatcher, load_preset
from svdm_core.evaluation.datasets import middlebury_scenes, read_middlebury_scene
from svdm_core.evaluation.paper import PAPER_STUDY
from svdm_core.evaluation.streaks import streak_share
from svdm_core.tuning.judges import TruthJudge
from svdm_core.tuning.optimization import Evaluator, joint_search, one_at_a_time
from svdm_core.tuning.ranges import parse_range
from svdm_core.tuning.stage_reuse import StageReuse
from svdm_core.tuning.store import FigureStore


@pytest.fixture(scope='module')
def scenes(tmp_path_factory):
    folder = write_scenes(tmp_path_factory.mktemp('scenes'))
    return [read_middlebury_scene(path) for path in middlebury_scenes(folder)]


@pytest.mark.parametrize('preset', ['default', 'fast', 'paper'])
def test_kept_stages_give_what_matching_anew_gives(preset, scenes, monkeypatch):
    reuse, matched = StageReuse(threads=1), []
    compute, match = StereoMatcher.compute, StereoMatcher.match
    monkeypatch.setattr(StereoMatcher, 'match', lambda *arguments: matched.append(1) or match(*arguments))
    base = load_preset(preset).replace(num_disparities=16)
    changes = [{}, {'w_p': 5}, {'final_median': 1}, {'sigma_s': 2.0, 'tau_lr': 0.0}, {'median_scope': 'all'},
               {'sigma_c': 0.5}, {'median_guide': 'disparity', 'median_scope': 'all'}]
    for change in changes:
        for scene in scenes[:2]:
            got = reuse.result(scene.name, scene.left, scene.right, base.replace(**change))
            expected = compute(StereoMatcher(base.replace(**change), 1), scene.left, scene.right)
            np.testing.assert_array_equal(got.disparity, expected.disparity)
            np.testing.assert_array_equal(got.valid, expected.valid)
    assert len(matched) == 2
    scene = scenes[0]
    got = reuse.result(scene.name, scene.left, scene.right, base.replace(alpha=1.0)).disparity
    np.testing.assert_array_equal(got, compute(StereoMatcher(base.replace(alpha=1.0), 1), scene.left,
                                               scene.right).disparity)
    assert len(matched) == 3


def test_one_at_a_time_goes_on_from_the_best(scenes):
    evaluate = Evaluator(scenes, TruthJudge(4.0), threads=1)
    start = evaluate(load_preset('paper_start'))
    ranges = [parse_range('alpha=0.5,5,20'), parse_range('w_p=1:11:4'), parse_range('sigma_s=0.1,0.2')]
    steps = one_at_a_time(evaluate, start, ranges)
    best = start
    for step, entry in zip(steps, ranges, strict=True):
        for value, evaluation in zip(entry.values, step.evaluations, strict=True):
            assert evaluation.parameters == best.parameters.replace(**{entry.name: value})
        errors = [evaluation.average['avgerr_nonocc'] for evaluation in (best, *step.evaluations)]
        assert step.best.average['avgerr_nonocc'] == min(errors)
        assert step.improved == (min(errors[1:]) < errors[0])
        best = step.best
    assert not steps[-1].improved and steps[-1].best_value == 1.0  # hardly any reach: worse than the start, not taken


def test_the_figures_are_those_of_the_maps(scenes):
    evaluation = Evaluator(scenes, TruthJudge(2.0), threads=1)(MatcherParameters(alpha=3.0))
    scene = scenes[0]
    result = StereoMatcher(MatcherParameters(alpha=3.0, num_disparities=16), 1).compute(scene.left, scene.right)
    error = 2 * np.abs(result.disparity - scene.ground_truth)
    assert tuple(evaluation.scenes['Attic']) == tuple(TruthJudge.headings)
    assert evaluation.scenes['Attic']['avgerr_all'] == pytest.approx(error.mean())
    assert evaluation.scenes['Attic']['bad4_nonocc'] == pytest.approx(100 * (error[scene.nonocc] > 4).mean())
    assert evaluation.scenes['Attic']['streaks'] == streak_share(result.disparity, scene.left)
    each = [evaluation.scenes[name]['avgerr_all'] for name in ('Attic', 'Barn', 'PianoL')]
    assert evaluation.average['avgerr_all'] == pytest.approx((each[0] + each[1] + each[2] / 2) / 2.5)


def test_wrong_arguments_of_a_study_are_named(scenes):
    evaluate = Evaluator(scenes[:1], TruthJudge(4.0), threads=1)
    start = evaluate(MatcherParameters())
    for study in (lambda *rest: one_at_a_time(evaluate, start, [], *rest),
                  lambda *rest: joint_search(evaluate, start, [], 3, *rest)):
        with pytest.raises(ValueError, match="objective = 'avgerr' is not allowed: it must be"):
            study('avgerr')
    with pytest.raises(ValueError, match='0 trials are not allowed'):
        joint_search(evaluate, start, [], 0)
    with pytest.raises(ValueError, match='no scene to tune on'):
        Evaluator([], TruthJudge(4.0))


def test_a_file_that_is_no_storage_is_left_alone(tmp_path):
    for text in ('precious', '{"a": 1}\n', '{"key": "a", "figures": {}}\nprecious\n', '[]\n', 'x\n'):
        (tmp_path / 's').write_text(text)
        with pytest.raises(ValueError, match=r'line \d is not of a file of svdm tune'):
            FigureStore(tmp_path / 's')
        assert (tmp_path / 's').read_text() == text
    with pytest.raises(ValueError, match='is a folder: give a regular file'):
        FigureStore(tmp_path)


def test_ground_truth_has_no_streaks():
    assert max(streak_share(scene.ground_truth, scene.left) for scene in real_scenes()) < 0.005


def test_the_papers_steps_reduce_streaks_on_its_figure_1():
    """Start, then alpha, sigma_s, sigma_c, w_p of the optimum; the step of sigma_c is too small to tell."""
    evaluate = Evaluator(real_scenes('Adirondack', 'MotorcycleE', 'Recycle'), TruthJudge(4.0))
    parameters = load_preset('paper_start')
    along = [evaluate(parameters)]
    for table in PAPER_STUDY:
        parameters = parameters.replace(**{table.parameter: table.chosen})
        along.append(evaluate(parameters))
    for name in along[0].scenes:
        start, alpha, sigma_s, sigma_c, w_p = (evaluation.scenes[name]['streaks'] for evaluation in along)
        print(f'{name}: {start:.3f} {alpha:.3f} {sigma_s:.3f} {sigma_c:.3f} {w_p:.3f} %')
        assert start > alpha > 4 * sigma_s and sigma_c < 0.5 * alpha and w_p < 0.25 * sigma_c
