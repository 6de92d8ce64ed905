"""Finding parameters: one at a time, as the paper does, or jointly."""
from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Callable, Sequence
from typing import Any

from ..evaluation.datasets import MIDDLEBURY_WEIGHTS, StereoScene
from ..evaluation.metrics import error_metrics, weighted_average
from ..evaluation.streaks import streak_share
from ..kernels.arrays import Float32
from ..missing_modules import not_installed
from ..parameters import MatcherParameters
from .ranges import ParameterRange, Value, once_each
from .stage_reuse import StageReuse
from .store import FigureStore, scene_fingerprint

FIGURES = ('avgerr_nonocc', 'avgerr_all', 'bad2_nonocc', 'bad2_all', 'bad4_nonocc', 'bad4_all', 'streaks')
"""avgerr in full-resolution px, the rest in %. Smaller is better."""

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
    """Matches all scenes under given parameters and judges the maps. Nothing is computed twice.

    `maps` counts the maps that were computed, and not known from the store.
    """

    def __init__(
        self,
        scenes: Sequence[StereoScene],
        factor: float = 4.0,
        threads: int = 0,
        store: FigureStore | None = None,
        advance: Callable[[], None] = lambda: None,
    ) -> None:
        """factor: full-resolution px per px of the images. advance: called after each scene.

        ValueError where there is no scene.
        """
        if not scenes:
            raise ValueError('no scene to tune on')
        self.scenes = list(scenes)
        self.maps = 0
        self._factor = factor
        self._advance = advance
        self._matcher = StageReuse(threads)
        self._store = store or FigureStore()
        self._fingerprints = {scene.name: scene_fingerprint(scene) for scene in scenes}

    def __call__(self, parameters: MatcherParameters) -> Evaluation:
        """Figures under `parameters`; the search range is each scene's. ValueError where a figure is not a number."""
        figures = {scene.name: self._figures(scene, parameters) for scene in self.scenes}
        return Evaluation(parameters, weighted_average(figures, MIDDLEBURY_WEIGHTS), figures)

    def disparity(self, scene: StereoScene, parameters: MatcherParameters) -> Float32:
        """float32 (H, W), px."""
        fitted = _fitted(parameters, scene)
        return self._matcher.disparity(scene.name, scene.left, scene.right, fitted)

    def _figures(self, scene: StereoScene, parameters: MatcherParameters) -> dict[str, float]:
        fitted = _fitted(parameters, scene).as_dict()
        basis = json.dumps([fitted, self._factor, self._fingerprints[scene.name]])
        key = hashlib.sha256(basis.encode()).hexdigest()
        figures = self._store.get(key)
        if figures is None:
            figures = judged(self.disparity(scene, parameters), scene, self._factor)
            self.maps += 1
            self._store.put(key, figures, scene=scene.name, parameters=fitted)
        self._advance()
        return figures


def judged(disparity: Float32, scene: StereoScene, factor: float) -> dict[str, float]:
    """FIGURES of a disparity map (H, W). ValueError where one is not a number."""
    nonocc = error_metrics(disparity, scene.ground_truth, scene.nonocc, factor)
    everywhere = error_metrics(disparity, scene.ground_truth, None, factor)
    figures = {f'{name}_{region}': values[name] for name in ('avgerr', 'bad2', 'bad4')
               for region, values in (('nonocc', nonocc), ('all', everywhere))}
    figures['streaks'] = streak_share(disparity, scene.left)
    for name, value in figures.items():
        if not math.isfinite(value):
            raise ValueError(f'scene {scene.name}: {name} is {value}: its mask has no pixel with known ground truth')
    return figures


def one_at_a_time(
    evaluate: Evaluator, start: Evaluation, ranges: Sequence[ParameterRange], objective: str = 'avgerr_nonocc',
) -> list[Step]:
    """Vary one parameter after the other, each from the best so far: the first with the smallest figure `objective`."""
    _check_objective(objective)
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
    _check_objective(objective)
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


def _fitted(parameters: MatcherParameters, scene: StereoScene) -> MatcherParameters:
    return parameters.replace(min_disparity=0, num_disparities=scene.num_disparities)


def _check_objective(objective: str) -> None:
    if objective not in FIGURES:
        raise ValueError(f'objective = {objective!r} is not allowed: it must be {" | ".join(FIGURES)}')
