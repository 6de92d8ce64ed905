"""Ladders, the climb, the choice of pairs, the sets and ranks of the proof."""
import dataclasses

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svdm_core import MatcherParameters, load_preset, parameter_info
from svdm_core.tuning.climb import climb
from svdm_core.tuning.ladders import by_importance, ladder, ladders, near
from svdm_core.tuning.optimization import Evaluation
from svdm_core.tuning.pair_choice import FEWEST, choose_pairs
from svdm_core.tuning.proof import Proof, SpreadSet, spearman, spread_sets
from svdm_core.tuning.ranges import ParameterRange


class Judge:
    resolution = 1.0


class Bowl:
    """Least at p2 = 0.9 and w_p = 31, with a ridge of `step` before each improvement."""

    judge = Judge()

    def __init__(self):
        self.asked = []

    def check_objective(self, objective):
        assert objective == 'loss'

    def __call__(self, parameters):
        self.asked.append(parameters)
        loss = 50 * abs(parameters.p2 - 0.9) + abs(parameters.w_p - 31)
        return Evaluation(parameters, {'loss': loss}, {})


def test_steps_are_allowed_values_and_hold_the_default():
    for entry in ladders():
        info = parameter_info(entry.name)
        assert info.default in entry.values and len(set(entry.values)) == len(entry.values)
        assert [info.check(value) for value in entry.values] == list(entry.values)
        if entry.numeric:
            assert list(entry.values) == sorted(entry.values)
    assert [entry.name for entry in ladders()] == by_importance()
    with pytest.raises(ValueError, match='tau_lr has no steps of its own: give its values, as --vary tau_lr=a,b,c'):
        ladder('tau_lr')


def test_next_steps_are_those_around_a_value_and_the_default():
    entry = ladder('p2')
    assert near(entry, 0.9) == [0.6, 1.2] and near(entry, 0.0) == [0.3, 0.9] and near(entry, 0.7) == [0.6, 0.9]
    assert near(entry, 5.0) == [1.2, 0.9]
    assert near(ladder('gradient'), 'magnitude') == ['horizontal']


def test_it_climbs_to_the_bottom_one_step_at_a_time_and_stops_there():
    evaluate = Bowl()
    start = evaluate(MatcherParameters(p2=0.0, w_p=1))
    steps = climb(evaluate, start, [ladder('p2'), ladder('w_p')], 100, 'loss')
    assert (steps[-1].best.parameters.p2, steps[-1].best.parameters.w_p) == (0.9, 31)
    assert len(set(evaluate.asked)) == len(evaluate.asked) < 20
    for step in steps:
        assert step.evaluations[0].parameters != step.best.parameters or not step.improved
        assert step.improved == (step.best_value != step.range.values[0])


def test_it_makes_as_many_trials_as_it_may_and_repeats_itself():
    for trials in (1, 2, 5):
        found = []
        for _ in range(2):
            evaluate = Bowl()
            start = evaluate(load_preset('paper_start'))
            found.append(climb(evaluate, start, ladders(), trials, 'loss'))
            assert len(evaluate.asked) == 1 + trials
        assert found[0] == found[1]
    with pytest.raises(ValueError, match='0 trials are not allowed'):
        climb(Bowl(), start, ladders(), 0, 'loss')


def test_a_step_that_gains_next_to_nothing_is_not_taken():
    class Flat(Bowl):
        def __call__(self, parameters):
            return Evaluation(parameters, {'loss': 10 - 0.05 * parameters.alpha}, {})

    evaluate = Flat()
    entry = ParameterRange('alpha', (10.0, 10.7, 11.0))
    [step] = climb(evaluate, evaluate(MatcherParameters()), [entry], 9, 'loss')
    assert not step.improved and step.best_value == 10.7


@dataclasses.dataclass
class Source:
    name: str
    pairs: list
    num_disparities: int | None = None
    notes: tuple = ()

    def read(self, most):
        count = min(most, len(self.pairs))
        return iter(self.pairs[number * len(self.pairs) // count] for number in range(count))


def textured(level, seed=0, shape=(60, 80)):
    rng = np.random.default_rng(seed)
    image = np.clip(level + rng.integers(-40, 40, shape), 0, 255).astype(np.uint8)
    return image, image


def test_pairs_that_differ_are_chosen_in_their_order():
    alike = [textured(60)] * 20
    source = Source('street', [textured(120, 2), *alike[:19], textured(200, 1), *alike, alike[0]])
    found = choose_pairs([source], 5, (0, None))
    names = [pair.name for pair in found.pairs]
    assert len(names) == 5 and names == sorted(names, key=lambda name: int(name.split()[1].split('/')[0]))
    means = [round(float(pair.left.mean()), -1) for pair in found.pairs]
    assert {60, 120, 200} <= set(means)
    assert found.notes == [] and found.rows == {} and found.pairs[0].num_disparities == 16
    assert [pair.name for pair in choose_pairs([source], 5, (0, None)).pairs] == names


def test_black_pairs_are_not_chosen_where_others_are():
    black = (np.zeros((60, 80), np.uint8),) * 2
    source = Source('night', [black] * 10 + [textured(90, seed) for seed in range(6)])
    found = choose_pairs([source], 8, (-4, 32))
    assert all(pair.left.any() for pair in found.pairs) and {(pair.min_disparity, pair.num_disparities)
                                                             for pair in found.pairs} == {(-4, 32)}
    only = choose_pairs([Source('night', [black] * 3)], 8, (0, 32))
    assert len(only.pairs) == 3 and f'takes {FEWEST} or more' in only.notes[0] and 'texture' in only.notes[1]


def test_scenes_of_cameras_of_their_own_have_their_own_range():
    sources = [Source(name, [textured(90, number)], 10 * number) for number, name in enumerate('abcdef', 2)]
    found = choose_pairs(sources, 5, (0, None))
    assert len(found.pairs) == 5
    assert all(pair.num_disparities == {'a': 20, 'b': 30, 'c': 40, 'd': 50, 'e': 60, 'f': 70}[pair.name]
               for pair in found.pairs)


def test_sets_are_spread_different_and_the_same_each_time():
    sets = spread_sets(60)
    assert sets == spread_sets(60) and len({one.parameters for one in sets}) == 60
    assert [one.base for one in sets[:5]] == ['default', 'accurate', 'fast', 'paper', 'paper_start']
    assert all(one.parameters == load_preset(one.base) for one in sets[:5])
    assert all(sum(one.base == base for one in sets) >= 10 for base in ('default', 'fast', 'paper'))


@given(st.lists(st.integers(0, 5), min_size=3, max_size=30), st.integers(0, 2**32 - 1))
def test_the_rank_correlation_is_that_of_scipy(values, seed):
    stats = pytest.importorskip('scipy.stats')
    one = np.array(values, float)
    other = np.random.default_rng(seed).integers(0, 5, len(values)).astype(float)
    if np.ptp(one) and np.ptp(other):
        assert spearman(one, other) == pytest.approx(float(stats.spearmanr(one, other).statistic), abs=1e-9)
    else:
        assert spearman(one, other) == 0


def proof(losses, errors):
    losses, errors = np.array(losses, float), np.array(errors, float)
    sets = [SpreadSet('default', MatcherParameters(alpha=float(number))) for number in range(len(losses))]
    return Proof(sets, ['a', 'b'], losses, {'avgerr_nonocc': errors}, (losses, 0 * losses, 0 * losses))


def test_a_choice_costs_what_lies_between_it_and_the_best():
    found = proof([[9, 9], [8, 8], [5, 9]], [[4, 4], [3, 3], [6, 2]]).regret(2)
    assert found.chosen == pytest.approx(1.0)  # (6 + 2) / 2 for the third, where the second has 3
    assert found.kept == pytest.approx(1.0) and found.worst == pytest.approx(0.0)
    careful = proof([[9, 9], [8.9, 8.9], [9, 9]], [[4, 4], [7, 7], [4, 4]]).regret(2)
    assert careful.chosen == pytest.approx(3.0) and careful.worst == 0  # less than the resolution: kept
    perfect = proof([[1, 3], [2, 2], [3, 1]], [[1, 3], [2, 2], [3, 1]])
    assert perfect.correlations('avgerr_nonocc') == [1.0, 1.0] and perfect.regret(1).chosen == 0
    assert perfect.left_out('avgerr_nonocc')[0].spearman == 1.0
