"""A search with few trials near the start, for an objective that leads astray whoever follows it far."""
from __future__ import annotations

from collections.abc import Sequence

from .ladders import near
from .optimization import Evaluation, Evaluator, Step
from .ranges import ParameterRange

LEAST = 0.1
"""Share of the objective's resolution by which a step has to be better to be taken."""


def climb(
    evaluate: Evaluator, start: Evaluation, ladders: Sequence[ParameterRange], trials: int, objective: str,
) -> list[Step]:
    """One parameter after the other moves to the best of the steps next to it, or to its default, where that is better;
    round after round, until nothing is or `trials` evaluations are made.

    ladders: the most important first, as the trials may end before the last. ValueError for a wrong objective or
    number.
    """
    evaluate.check_objective(objective)
    if trials < 1:
        raise ValueError(f'{trials} trials are not allowed: it must be 1 or more')
    steps: list[Step] = []
    best, left = start, trials
    tried: set[object] = {start.parameters}
    while left:
        before = best
        for entry in ladders:
            step = _step(evaluate, best, entry, left, objective, tried)
            if step is None:
                continue
            left -= len(step.evaluations) - 1  # the first is what was there
            best = step.best
            steps.append(step)
        if best is before:
            break
    return steps


def _step(
    evaluate: Evaluator, best: Evaluation, entry: ParameterRange, most: int, objective: str, tried: set[object],
) -> Step | None:
    """None where there is nothing new to try."""
    wanted = [best.parameters.replace(**{entry.name: value})
              for value in near(entry, getattr(best.parameters, entry.name))]
    new = [parameters for parameters in wanted if parameters not in tried][:most]
    if not new:
        return None
    tried.update(new)
    evaluations = [evaluate(parameters) for parameters in new]
    found = min(evaluations, key=lambda evaluation: evaluation.average[objective])
    least = LEAST * evaluate.judge.resolution
    improved = found.average[objective] < best.average[objective] - least
    values = tuple(getattr(parameters, entry.name) for parameters in new)
    shown = ParameterRange(entry.name, (getattr(best.parameters, entry.name), *values))
    return Step(shown, [best, *evaluations], found if improved else best, improved)
