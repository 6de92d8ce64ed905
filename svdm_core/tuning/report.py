"""What a study found, as a document (for JSON and the page) and as a table on the terminal."""
from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from ..evaluation.paper import PAPER_STUDY, PaperStudyTable
from ..parameters import MatcherParameters
from .optimization import FIGURES, Evaluation, Evaluator, Step

HEADINGS = {'avgerr_nonocc': 'avgerr nonocc px', 'avgerr_all': 'avgerr all px', 'bad2_nonocc': 'bad2 nonocc %',
            'bad2_all': 'bad2 all %', 'bad4_nonocc': 'bad4 nonocc %', 'bad4_all': 'bad4 all %',
            'streaks': 'streaks %'}

_WIDTH = 140  # characters, where the output is no terminal


@dataclasses.dataclass(frozen=True, slots=True)
class Study:
    """What was done and found: `steps` one at a time, or `trials` of a joint search over `varied`.

    row_alignment: scene -> what its right image was aligned by, of plain types; None where that was not asked for.
    """

    evaluate: Evaluator
    objective: str
    start: Evaluation
    steps: list[Step]
    trials: list[Evaluation]
    varied: list[str]
    against_paper: bool = False
    row_alignment: dict[str, Any] | None = None

    @property
    def best(self) -> Evaluation:
        """The best of all, the start included; the earliest among equals."""
        known = [self.start, *(step.best for step in self.steps), *self.trials]
        return min(known, key=lambda evaluation: evaluation.average[self.objective])


def document(study: Study) -> dict[str, Any]:
    """Everything found, of plain types."""
    return {
        'objective': study.objective,
        'scenes': [scene.name for scene in study.evaluate.scenes],
        'row_alignment': study.row_alignment,
        'start': _plain(study.start),
        'steps': [_step(step, study.against_paper) for step in study.steps],
        'trials': [{'values': {name: getattr(trial.parameters, name) for name in study.varied}, **_plain(trial)}
                   for trial in study.trials],
        'best': _plain(study.best),
        'changed': changed(study.start.parameters, study.best.parameters),
    }


def changed(before: MatcherParameters, after: MatcherParameters) -> dict[str, Any]:
    """The values of `after` that differ."""
    old = before.as_dict()
    return {name: value for name, value in after.as_dict().items() if value != old[name]}


def paper_table(step: Step) -> PaperStudyTable | None:
    """The table of the paper that varies the same parameter over the same values."""
    for table in PAPER_STUDY:
        if (table.parameter, table.values) == (step.range.name, step.range.values):
            return table
    return None


def difference(step: Step, table: PaperStudyTable) -> str:
    """One line: in what a step differs from the paper's table, the curves and where they are lowest."""
    nonocc, everywhere = ([evaluation.average[name] for evaluation in step.evaluations]
                          for name in ('avgerr_nonocc', 'avgerr_all'))
    parts = [f'the best {table.parameter} by avgerr {region} is {_smallest(table, ours)} '
             f'(the paper: {_smallest(table, theirs)})'
             for region, ours, theirs in (('nonocc', nonocc, table.nonocc), ('all', everywhere, table.everywhere))]
    parts.append(f'the paper goes on with {table.chosen:g}, this study with {step.best_value}')
    for name, ours, theirs in (('nonocc', nonocc, table.nonocc), ('all', everywhere, table.everywhere)):
        apart = [a - b for a, b in zip(ours, theirs, strict=True)]
        parts.append(f'avgerr {name} {min(apart):+.2f} to {max(apart):+.2f} px from the paper, which spans '
                     f'{max(theirs) - min(theirs):.2f} px over the range where here it is {max(ours) - min(ours):.2f}')
    return '; '.join(parts)


def print_table(study: Study) -> None:
    """The start, the best of each step or the best trials, and the best of all."""
    table = Table(title=f'{len(study.evaluate.scenes)} scenes, by {HEADINGS[study.objective]}')
    for heading in ('', *HEADINGS.values()):
        table.add_column(heading, justify='right' if heading else 'left')
    for label, evaluation in path(study):
        table.add_row(label, *(f'{evaluation.average[name]:.3f}' for name in FIGURES))
    console = Console()
    console = console if console.is_terminal else Console(width=_WIDTH)
    console.print(table)
    new = changed(study.start.parameters, study.best.parameters)
    best = ', '.join(f'{name} = {value}' for name, value in new.items()) or 'as at the start'
    console.print(f'best: {best}', soft_wrap=True, highlight=False)


def path(study: Study) -> list[tuple[str, Evaluation]]:
    """The way from the start to the best, with a label each."""
    if study.trials:
        return [('start', study.start), ('best of the search', study.best)]
    return [('start', study.start), *(_labelled(step) for step in study.steps)]


def _labelled(step: Step) -> tuple[str, Evaluation]:
    kept = '' if step.improved else ' (kept)'
    return f'{step.range.name} = {step.best_value}{kept}', step.best


def _smallest(table: PaperStudyTable, figures: Sequence[float]) -> str:
    """The first value with the smallest figure, and how many have it too."""
    least = min(figures)
    others = list(figures).count(least) - 1
    if others == len(figures) - 1:
        return 'any, all alike'
    return f'{table.values[list(figures).index(least)]:g}' + (f' and {others} more alike' if others else '')


def _step(step: Step, against_paper: bool) -> dict[str, Any]:
    table = paper_table(step) if against_paper else None
    return {
        'parameter': step.range.name,
        'values': list(step.range.values),
        'figures': [evaluation.average for evaluation in step.evaluations],
        'best': _plain(step.best),
        'best_value': step.best_value,
        'improved': step.improved,
        'paper': dataclasses.asdict(table) if table else None,
        'differs_from_paper': difference(step, table) if table else None,
    }


def _plain(evaluation: Evaluation) -> dict[str, Any]:
    return {'parameters': evaluation.parameters.as_dict(), 'average': evaluation.average, 'scenes': evaluation.scenes}
