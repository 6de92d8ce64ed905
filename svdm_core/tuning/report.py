"""What a study found, as a document (for JSON and the page) and as a table on the terminal."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.table import Table

from ..evaluation.paper import PAPER_STUDY, PaperStudyTable
from ..parameters import MatcherParameters
from .importance import Importance
from .optimization import Evaluation, Evaluator, Step

_WIDTH = 140  # characters, where the output is no terminal


@dataclasses.dataclass(frozen=True, slots=True)
class Study:
    """What was done and found: `steps` one at a time, or `trials` of a joint search over `varied`.

    climbed: whether the steps are those of `climb`, most of which lead nowhere; it begins at `defaults`, the defaults
    of all that has steps, where those are better than the start. row_alignment: scene -> what its right image was
    aligned by, of plain types; None where that was not asked for. notes: what should be known of the scenes.
    """

    evaluate: Evaluator
    objective: str
    start: Evaluation
    steps: list[Step]
    trials: list[Evaluation]
    varied: list[str]
    against_paper: bool = False
    climbed: bool = False
    defaults: Evaluation | None = None
    row_alignment: dict[str, Any] | None = None
    importances: Sequence[Importance] = ()
    notes: Sequence[str] = ()

    def with_found(self, **found: Any) -> Study:
        """A copy with what came of it: steps, trials or importances."""
        return dataclasses.replace(self, **found)

    @property
    def headings(self) -> Mapping[str, str]:
        """Figure -> its heading with unit."""
        return self.evaluate.judge.headings

    @property
    def best(self) -> Evaluation:
        """The best of all, the start included and kept where what was gained says nothing; the earliest among equals.
        """
        tried = [self.start, *([self.defaults] if self.defaults else []), *(step.best for step in self.steps),
                 *self.trials]
        least = min(tried, key=lambda evaluation: evaluation.average[self.objective])
        gained = self.start.average[self.objective] - least.average[self.objective]
        return self.start if gained < self.evaluate.judge.resolution else least


def document(study: Study) -> dict[str, Any]:
    """Everything found, of plain types."""
    return {
        'objective': study.objective,
        'scenes': [scene.name for scene in study.evaluate.scenes],
        'notes': list(study.notes),
        'row_alignment': study.row_alignment,
        'start': _plain(study.start),
        'defaults': None if study.defaults is None else _plain(study.defaults),
        'steps': [_step(step, study.against_paper) for step in study.steps],
        'trials': [{'values': {name: getattr(trial.parameters, name) for name in study.varied}, **_plain(trial)}
                   for trial in study.trials],
        'best': _plain(study.best),
        'changed': changed(study.start.parameters, study.best.parameters),
        'importance': [entry.document() for entry in study.importances],
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
    table = Table(title=f'{len(study.evaluate.scenes)} scenes, by {study.headings[study.objective]}')
    for heading in ('', *study.headings.values()):
        table.add_column(heading, justify='right' if heading else 'left')
    for label, evaluation in path(study):
        table.add_row(label, *(f'{evaluation.average[name]:.3f}' for name in study.headings))
    console = Console()
    console = console if console.is_terminal else Console(width=_WIDTH)
    console.print(table)
    if not study.importances:
        console.print(verdict(study), soft_wrap=True, highlight=False)
    else:
        table = Table(title=f'what each parameter does to {study.headings[study.objective]}, all others as they are')
        for heading in ('', 'spread', 'gain', 'at its best'):
            table.add_column(heading, justify='right' if heading else 'left')
        for entry in study.importances:
            table.add_row(entry.name, f'{entry.spread:.3f}', f'{entry.gain:.3f}', str(entry.best_value))
        console.print(table)


def verdict(study: Study) -> str:
    """One line: the best parameters, or why there are none that are better."""
    new = changed(study.start.parameters, study.best.parameters)
    if new:
        return 'best: ' + ', '.join(f'{name} = {value}' for name, value in new.items())
    least = study.evaluate.judge.resolution
    if not least or not (study.steps or study.trials):
        return 'best: as at the start'
    return f'no difference: nothing that was tried is better by {least:g} or more, so keep what you have'


def path(study: Study) -> list[tuple[str, Evaluation]]:
    """The way from the start to the best, with a label each."""
    if study.trials:
        return [('start', study.start), ('best of the search', study.best)]
    way = [('start', study.start), *(_labelled(step) for step in study.steps if step.improved or not study.climbed)]
    if study.defaults is not None:
        way.insert(1, ('the defaults of all that has steps', study.defaults))
    return way


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
