"""Finding parameters: one at a time, as the paper does, or jointly."""
from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Sequence
from typing import Any

from ..evaluation.metrics import weighted_average
from ..matcher import DisparityResult
from ..missing_modules import not_installed
from ..parameters import MatcherParameters
from .image_pair import AnyPair, fitted, pair_fingerprint
from .judges import Judge
from .ranges import ParameterRange, Value, once_each
from .stage_reuse import StageReuse
from .store import FigureStore, sources_fingerprint

_SEED = 0


@dataclasses.dataclass(frozen=True, slots=True)
class Evaluation:
    """Figures under a set of parameters: the weighted average over the scenes, and those of each scene."""

    parameters: MatcherParameters
    average: dict[str, float]
    scenes: dict[str, dict[str, float]]


@dataclasses.dataclass(frozen=True, slots=True)
class Step:
    """One parameter varied: an evaluation for each value of the range, and the best so far, from which it goes on.

    `improved` is False where no value of the range was better than what was there before.
    """

    range: ParameterRange
    evaluations: list[Evaluation]
    best: Evaluation
    improved: bool

    @property
    def best_value(self) -> Value:
        """The value it goes on with."""
        value: Value = getattr(self.best.parameters, self.range.name)
        return value


class Evaluator:
    """Matches all pairs under given parameters and judges the maps. Nothing is computed twice.

    `maps` counts the maps that were computed, and not known from the store.
    """

    def __init__(
        self,
        scenes: Sequence[AnyPair],
        judge: Judge,
        threads: int = 0,
        store: FigureStore | None = None,
        advance: Callable[[], None] = lambda: None,
    ) -> None:
        """judge: of pairs of this kind. advance: called after each pair. ValueError where there is none."""
        if not scenes:
            raise ValueError('no scene to tune on')
        self.scenes = list(scenes)
        self.judge = judge
        self.maps = 0
        self._advance = advance
        self._matcher = StageReuse(threads)
        self._store = store or FigureStore()
        self._fingerprints = {scene.name: pair_fingerprint(scene) for scene in scenes}

    def __call__(self, parameters: MatcherParameters) -> Evaluation:
        """Figures under `parameters`; the search range is each scene's. ValueError where a figure is not a number."""
        figures = {scene.name: self._figures(scene, parameters) for scene in self.scenes}
        return Evaluation(parameters, weighted_average(figures, self.judge.weights), figures)

    def result(self, scene: AnyPair, parameters: MatcherParameters) -> DisparityResult:
        """What comes of one of the scenes."""
        return self._matcher.result(scene.name, scene.left, scene.right, fitted(parameters, scene))

    def check_objective(self, objective: str) -> None:
        """ValueError where it is no figure of the judge."""
        if objective not in self.judge.headings:
            raise ValueError(f'objective = {objective!r} is not allowed: it must be {" | ".join(self.judge.headings)}')

    def _figures(self, scene: AnyPair, parameters: MatcherParameters) -> dict[str, float]:
        values = fitted(parameters, scene).as_dict()
        basis = json.dumps([values, self.judge.name, self._fingerprints[scene.name], sources_fingerprint()])
        key = hashlib.sha256(basis.encode()).hexdigest()
        figures = self._store.get(key)
        if figures is None:
            figures = self.judge.figures(self.result(scene, parameters), scene)
            self.maps += 1
            self._store.put(key, figures, scene=scene.name, parameters=values)
        self._advance()
        return figures


def one_at_a_time(
    evaluate: Evaluator, start: Evaluation, ranges: Sequence[ParameterRange], objective: str = 'avgerr_nonocc',
) -> list[Step]:
    """Vary one parameter after the other, each from the best so far: the first with the smallest figure `objective`."""
    evaluate.check_objective(objective)
    steps: list[Step] = []
    best = start
    for entry in ranges:
        evaluations = [evaluate(best.parameters.replace(**{entry.name: value})) for value in entry.values]
        found = min(evaluations, key=lambda evaluation: evaluation.average[objective])
        improved = found.average[objective] < best.average[objective]
        best = found if improved else best
        steps.append(Step(entry, evaluations, best, improved))
    return steps


def joint_search(
    evaluate: Evaluator,
    start: Evaluation,
    ranges: Sequence[ParameterRange],
    trials: int,
    objective: str = 'avgerr_nonocc',
) -> list[Evaluation]:
    """`trials` evaluations that Optuna's sampler (TPE) chooses, all parameters at once.

    The same arguments give the same trials, and more trials go on behind them: with a store, a search is resumed by
    running it again. (A sampler resumed from Optuna's own storage would begin its random numbers anew, and repeat
    itself.) ValueError for wrong arguments, ImportError without Optuna.
    """
    evaluate.check_objective(objective)
    once_each(ranges)
    if trials < 1:
        raise ValueError(f'{trials} trials are not allowed: it must be 1 or more')
    try:
        import optuna
    except ImportError:
        raise ImportError(not_installed(['optuna'])) from None
    optuna.logging.set_verbosity(optuna.logging.WARNING)
    study = optuna.create_study(sampler=optuna.samplers.TPESampler(seed=_SEED))
    found = []
    for _ in range(trials):
        trial = study.ask()
        values = {entry.name: _suggested(trial, entry) for entry in ranges}
        found.append(evaluate(start.parameters.replace(**values)))
        study.tell(trial, found[-1].average[objective])
    return found


def _suggested(trial: Any, entry: ParameterRange) -> Value:
    last = len(entry.values) - 1  # places instead of values keep their order, and the decimals
    if entry.numeric:
        return entry.values[int(trial.suggest_int(entry.name, 0, last))]
    return entry.values[int(trial.suggest_categorical(entry.name, list(range(last + 1))))]
