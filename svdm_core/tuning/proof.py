"""The proof of the unsupervised loss: how well it ranks parameter sets that ground truth ranks, too."""
from __future__ import annotations

import dataclasses
import itertools
import random
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..evaluation.datasets import StereoScene
from ..matcher import DisparityResult
from ..parameters import MatcherParameters
from ..presets import load_preset
from .judges import DISAGREEMENT_WEIGHT, JUMP_WEIGHT, TruthJudge, UnsupervisedJudge
from .ladders import ladders
from .optimization import Evaluation

TRUTHS = ('avgerr_nonocc', 'avgerr_all', 'bad4_nonocc')
"""Figures that the loss is compared with."""
BASES = ('default', 'accurate', 'fast', 'paper', 'paper_start')
"""Presets that the sets are made from."""
_MOST_CHANGES = 6
_BEYOND = (0.25, 0.5, 2.0, 4.0)
"""Factors by which a number is changed, besides the steps of its ladder."""
_WEIGHTS = tuple(itertools.product((0.0, 0.4, 0.8, 1.2, 1.6), (0.0, 0.4, 0.8, 1.2, 2.0, 3.0, 5.0)))
"""Of jumps and disagreement, tried where a scene is left out."""
_GROUPS = 200
"""Groups of pairs that a set is chosen on."""
_SEED = 0

Matrix = NDArray[np.float64]


class SpreadSet(NamedTuple):
    """One of the sets. base: the preset it was made from."""

    base: str
    parameters: MatcherParameters


class BothJudges:
    """The errors and the loss of one and the same map."""

    plots: tuple[tuple[str, tuple[str, ...]], ...] = ()
    resolution = 0.0
    explanation = ''

    def __init__(self, factor: float, threads: int = 0) -> None:
        """factor: full-resolution px per px of the images. threads: as of UnsupervisedJudge."""
        self._truth, self._loss = TruthJudge(factor), UnsupervisedJudge(threads)
        self.headings: Mapping[str, str] = {**self._truth.headings, **self._loss.headings}
        self.weights: Mapping[str, float] = {}  # each scene alike
        self.name = f'{self._truth.name}, {self._loss.name}'

    def figures(self, result: DisparityResult, pair: StereoScene) -> dict[str, float]:
        return {**self._truth.figures(result, pair), **self._loss.figures(result, pair)}


def spread_sets(count: int) -> list[SpreadSet]:
    """`count` different sets, good and bad, an equal share from each of five presets: the preset, then it with one to
    six parameters changed, to a step of their ladder or to a fraction or multiple. The same ones every time."""
    chance = random.Random(_SEED)
    sets: dict[MatcherParameters, SpreadSet] = {}
    for number in itertools.count():
        base = BASES[number % len(BASES)]
        parameters = load_preset(base)
        if number >= len(BASES):
            parameters = _changed(parameters, chance)
        sets.setdefault(parameters, SpreadSet(base, parameters))
        if len(sets) == count:
            return list(sets.values())
    raise AssertionError('unreachable')


def _changed(parameters: MatcherParameters, chance: random.Random) -> MatcherParameters:
    values: dict[str, Any] = {}
    entries = sorted(ladders(), key=lambda entry: entry.name)  # whatever is the most important
    for entry in chance.sample(entries, chance.randint(1, _MOST_CHANGES)):
        now = getattr(parameters, entry.name)
        if isinstance(now, float) and now > 0 and chance.random() < 0.5:
            values[entry.name] = now * chance.choice(_BEYOND)
        else:
            values[entry.name] = chance.choice([value for value in entry.values if value != now])
    try:
        return parameters.replace(**values)
    except ValueError:  # a multiple out of range
        return _changed(parameters, chance)


@dataclasses.dataclass(frozen=True, slots=True)
class Proof:
    """What the loss is worth. losses: (sets, scenes); errors: the same by figure; parts: mismatch, jumps, disagreement.
    """

    sets: list[SpreadSet]
    scenes: list[str]
    losses: Matrix
    errors: dict[str, Matrix]
    parts: tuple[Matrix, Matrix, Matrix]

    @classmethod
    def of(cls, sets: Sequence[SpreadSet], evaluations: Sequence[Evaluation]) -> Proof:
        """evaluations: of each set, by BothJudges."""
        scenes = list(evaluations[0].scenes)

        def matrix(figure: str) -> Matrix:
            return np.array([[found.scenes[scene][figure] for scene in scenes] for found in evaluations])

        return cls(list(sets), scenes, matrix('loss'), {name: matrix(name) for name in TRUTHS},
                   (matrix('mismatch'), matrix('jumps'), matrix('disagreement')))

    def correlations(self, truth: str) -> list[float]:
        """Spearman's, of loss and error over the sets, of each scene."""
        return [spearman(self.losses[:, scene], self.errors[truth][:, scene]) for scene in range(len(self.scenes))]

    def best_third(self, truth: str) -> list[float]:
        """The same among the third of the sets with the smallest error."""
        found = []
        for scene in range(len(self.scenes)):
            third = np.argsort(self.errors[truth][:, scene], kind='stable')[:max(2, len(self.sets) // 3)]
            found.append(spearman(self.losses[third, scene], self.errors[truth][third, scene]))
        return found

    def within(self, truth: str, base: str) -> list[float]:
        """The correlations among the sets of one preset only."""
        rows = [row for row, one in enumerate(self.sets) if one.base == base]
        return [spearman(self.losses[rows, scene], self.errors[truth][rows, scene])
                for scene in range(len(self.scenes))]

    def left_out(self, truth: str) -> list[LeftOut]:
        """For each scene the weights that rank best on all others, and the correlation that they have there."""
        table = self._table(truth)
        found = []
        for scene in range(len(self.scenes)):
            best = _best_without(table, [scene])
            found.append(LeftOut(*_WEIGHTS[best], float(table[best, scene])))
        return found

    def _weighted(self) -> Matrix:
        """Losses by _WEIGHTS, (weights, sets, scenes)."""
        mismatch, jumps, far = self.parts
        return np.array([mismatch + one * jumps + other * far for one, other in _WEIGHTS])

    def _table(self, truth: str) -> Matrix:
        """Correlations by _WEIGHTS, (weights, scenes)."""
        return np.array([[spearman(loss[:, scene], self.errors[truth][:, scene]) for scene in range(len(self.scenes))]
                         for loss in self._weighted()])

    def regret_left_out(self, pairs: int) -> float:
        """As `regret().chosen`, by weights that were chosen on all scenes but those of the group."""
        losses, table, errors = self._weighted(), self._table('avgerr_nonocc'), self.errors['avgerr_nonocc']
        found = []
        for group in _groups(len(self.scenes), pairs):
            best = _best_without(table, group)
            error = errors[:, group].mean(axis=1)
            found.append(error[losses[best][:, group].mean(axis=1).argmin()] - error.min())
        return float(np.mean(found))

    def regret(self, pairs: int, bases: Sequence[str] = BASES) -> Regret:
        """What a choice by the loss over `pairs` scenes costs, px. bases: among the sets of these presets, of which the
        first is the one that is kept."""
        rows = [row for base in bases for row, one in enumerate(self.sets) if one.base == base]
        losses, errors = self.losses[rows], self.errors['avgerr_nonocc'][rows]
        chosen, kept, careful = [], [], []
        for group in _groups(len(self.scenes), pairs):
            loss, error = losses[:, group].mean(axis=1), errors[:, group].mean(axis=1)
            best = int(loss.argmin())
            chosen.append(error[best] - error.min())
            kept.append(error[0] - error.min())
            gained = loss[0] - loss[best]
            careful.append(error[0 if gained < UnsupervisedJudge.resolution else best] - error[0])
        return Regret(float(np.mean(chosen)), float(np.mean(kept)), float(np.max(careful)))


class LeftOut(NamedTuple):
    """Weights of the loss that were chosen without a scene, and the rank correlation there."""

    jump_weight: float
    disagreement_weight: float
    spearman: float


class Regret(NamedTuple):
    """px of avgerr nonocc, the mean over groups of scenes. chosen, kept: how far the set with the smallest loss, and
    the first set, are above the best. worst: by how much, at worst, a choice is above the first set, which is kept
    where nothing is better by the resolution of the loss."""

    chosen: float
    kept: float
    worst: float


def _best_without(table: Matrix, scenes: Sequence[int]) -> int:
    """The place in _WEIGHTS of those that rank best on all scenes but these; of the built-in ones where none is left.
    """
    others = np.delete(table, scenes, axis=1)
    own = _WEIGHTS.index((JUMP_WEIGHT, DISAGREEMENT_WEIGHT))
    return int(others.mean(axis=1).argmax()) if others.size else own


def spearman(one: Matrix, other: Matrix) -> float:
    """Rank correlation, -1 .. 1; 0 where one of them is constant."""
    a, b = _ranks(one), _ranks(other)
    if np.ptp(a) == 0 or np.ptp(b) == 0:
        return 0.0
    return float(np.corrcoef(a, b)[0, 1])


def _ranks(values: Matrix) -> Matrix:
    """Those of equal values are the mean of theirs."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(count)
    return np.asarray((last - (count - 1) / 2)[place], np.float64)


def _groups(scenes: int, pairs: int) -> list[list[int]]:
    """All groups of so many scenes, or _GROUPS of them by chance; the same ones every time."""
    every = list(itertools.islice(itertools.combinations(range(scenes), min(pairs, scenes)), 10 * _GROUPS))
    if len(every) <= _GROUPS:
        return [list(group) for group in every]
    chance = random.Random(_SEED)
    return [sorted(chance.sample(range(scenes), pairs)) for _ in range(_GROUPS)]
