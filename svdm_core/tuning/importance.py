"""Which parameters matter: each swept over its steps, all others as they are."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from .optimization import Evaluation, Evaluator
from .ranges import ParameterRange, Value


@dataclasses.dataclass(frozen=True, slots=True)
class Importance:
    """What a parameter does to the objective. start: its value there. evaluations: one for each value of the range.
    spread: of the objective over all values, the one at the start included. gain: by how much the best value is below
    the start."""

    range: ParameterRange
    objective: str
    start: Value
    evaluations: list[Evaluation]
    spread: float
    gain: float

    @property
    def name(self) -> str:
        return self.range.name

    @property
    def best_value(self) -> Value:
        """The first of those with the smallest objective, the one at the start where none is better."""
        values = [evaluation.average[self.objective] for evaluation in self.evaluations]
        return self.range.values[values.index(min(values))] if self.gain > 0 else self.start

    def document(self) -> dict[str, Any]:
        """Of plain types."""
        return {'parameter': self.name, 'spread': self.spread, 'gain': self.gain, 'values': list(self.range.values),
                'figures': [evaluation.average for evaluation in self.evaluations]}


def importances(
    evaluate: Evaluator, start: Evaluation, ranges: Sequence[ParameterRange], objective: str,
) -> list[Importance]:
    """Of each range, the one with the largest spread first. ValueError for a wrong objective."""
    evaluate.check_objective(objective)
    found = [_importance(evaluate, start, entry, objective) for entry in ranges]
    return sorted(found, key=lambda entry: -entry.spread)


def _importance(evaluate: Evaluator, start: Evaluation, entry: ParameterRange, objective: str) -> Importance:
    evaluations = [evaluate(start.parameters.replace(**{entry.name: value})) for value in entry.values]
    here = start.average[objective]
    values = [here, *(evaluation.average[objective] for evaluation in evaluations)]
    now = getattr(start.parameters, entry.name)
    return Importance(entry, objective, now, evaluations, max(values) - min(values), here - min(values))
