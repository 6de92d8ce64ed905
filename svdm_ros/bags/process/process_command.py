"""What `process_bag` does: its options as jobs, the progress on the terminal, the summaries."""
from __future__ import annotations

import argparse
import contextlib
import dataclasses
import glob
import sys
from collections.abc import Callable, Generator, Iterator, Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from svdm_core import RowAlignment
from svdm_core.commands.argument_types import FROM_THE_PAIRS
from svdm_core.runtime import configure
from svdm_core.shown import cut, line, shown

from ...calibration.calibration_files import read_calibration
from ...command_line.parameters import node_parameters
from ...frames.outputs import output_names
from ...node.parameter_set import NodeParameters
from ..writing.output_place import check_apart
from ..writing.partial_folder import remove_marks
from .local_workers import process_locally
from .outcome import Outcome
from .processing import Job, Tell, process

_SUFFIXES = ('.zstd', '.mcap', '.db3', '.bag')


def run(options: argparse.Namespace) -> int:
    """Process the recordings and print the summaries; the exit code. ValueError, OSError, ImportError with one line."""
    configure()
    inputs = _inputs(options.inputs)
    parameters = _parameters(options.params or options.preset, options.changes)
    rows_file = options.align_rows if options.align_rows not in (None, FROM_THE_PAIRS) else None
    template = Job(
        inputs[0], options.output, parameters, left=options.left, right=options.right, start_s=options.start,
        duration_s=options.duration, copy_inputs=options.copy_inputs, outputs=_outputs(options, parameters),
        preview=options.preview,
        calibration=read_calibration(options.calib, colour=False) if options.calib else None, force=options.force,
        rows=RowAlignment.load(rows_file) if rows_file else None, estimate_rows=options.align_rows == FROM_THE_PAIRS)
    is_one = len(options.inputs) == len(inputs) == 1 and inputs[0] == Path(options.inputs[0]) and not options.scheduler
    jobs = [template] if is_one else _jobs(template, inputs)
    read = [*inputs, *(options.calib or ()), *filter(None, [rows_file]), Path(options.params or options.preset)]
    for job in jobs:
        if job.force:
            check_apart(job.output, read)
    return _run_one(template) if is_one else _run_many(jobs, options)


def _outputs(options: argparse.Namespace, parameters: NodeParameters) -> tuple[str, ...]:
    names, allowed = [name.strip() for name in options.outputs.split(',')], output_names(parameters)
    for name in names:
        if name not in allowed:
            raise ValueError(f'--outputs: {shown(name, 100)} is not allowed: it must be of {", ".join(allowed)}, '
                             'separated by commas')
    if options.preview and 'disparity' not in names:
        raise ValueError(f'--preview {options.preview} is drawn from the output disparity: add it to --outputs')
    return tuple(name for name in allowed if name in names)


def _run_one(job: Job) -> int:
    with progress() as bars:
        summary = process(job, bars.teller(job.input.name))
    print('\n'.join(map(line, summary.lines())))
    if summary.problem:
        print(f'process_bag: {line(summary.problem)}', file=sys.stderr)
    return summary.exit_code


def _run_many(jobs: Sequence[Job], options: argparse.Namespace) -> int:
    waiting = [job for job in jobs if job.force or not job.output.exists()]
    for job in jobs:
        if job not in waiting:
            remove_marks(job.output)
            print(line(f'{job.output}: is there already, skipped'))
    if not waiting:
        return 0
    options.output.mkdir(exist_ok=True)
    outcomes = []
    with progress() as bars, contextlib.closing(_outcomes(waiting, options, bars.teller)) as found:
        for outcome in found:
            bars.print('\n'.join(map(line, outcome.lines)))
            outcomes.append(outcome)
    for outcome in outcomes:
        if outcome.problem:
            print(f'process_bag: {line(outcome.problem)}', file=sys.stderr)
    if len(waiting) == len(jobs) and not any(outcome.lines for outcome in outcomes):
        return 2
    return 1 if any(outcome.exit_code for outcome in outcomes) else 0


def _outcomes(
    jobs: Sequence[Job], options: argparse.Namespace, teller: Callable[[str], Tell]
) -> Generator[Outcome, None, None]:
    if not options.scheduler:
        yield from process_locally(jobs, options.jobs or 1, teller)
        return
    from . import cluster_workers  # needs dask

    with cluster_workers.cluster(options.scheduler) as client:
        yield from cluster_workers.process_all(client, jobs, options.jobs, teller)


def _inputs(given: Sequence[str]) -> list[Path]:
    """Files and folders as they are, patterns as what they match."""
    found = []
    for text in given:
        matches = [Path(text)] if Path(text).exists() else [Path(match) for match in sorted(glob.glob(text))]
        if not matches:
            raise ValueError(f'{text}: there is no such file or folder')
        found += matches
    return found


def _jobs(template: Job, inputs: Sequence[Path]) -> list[Job]:
    """One a recording, with paths that mean the same to a worker that runs elsewhere."""
    folder = template.output.absolute()
    if (folder / 'metadata.yaml').exists() or (folder.exists() and not folder.is_dir()):
        raise ValueError(f'{template.output} is no folder for several bags: name another output')
    if not folder.parent.is_dir():
        raise ValueError(f'{template.output}: there is no folder {template.output.parent}')
    jobs: dict[Path, Job] = {}
    for path in inputs:
        output = folder / _bare_name(path)
        if output in jobs:
            raise ValueError(f'{jobs[output].input} and {path} would both become {output}: process them one by one')
        jobs[output] = dataclasses.replace(template, input=path.absolute(), output=output)
    return list(jobs.values())


def _bare_name(path: Path) -> str:
    name = path.absolute().name
    for suffix in _SUFFIXES:
        name = name.removesuffix(suffix)
    return name


def _parameters(source: str | Path, changes: Sequence[str]) -> NodeParameters:
    for change in changes:
        if change.partition('=')[0] == 'align_rows':
            raise ValueError(f'--set {cut(change)} is not allowed: it is for the live node; give --align-rows')
    return node_parameters(source, changes)


class _RateColumn(ProgressColumn):
    """Pairs a second."""

    def render(self, task: Task) -> Text:
        speed = task.finished_speed or task.speed
        return Text('' if speed is None else f'{speed:.1f} pairs/s')


class Bars:
    """One bar a recording."""

    def __init__(self, bars: Progress) -> None:
        self._bars = bars

    def teller(self, name: str) -> Callable[[int, int], None]:
        """What is told of the pairs done and of all there are."""
        task = self._bars.add_task(cut(name), total=None)
        return lambda done, total: self._bars.update(task, completed=done, total=max(done, total))

    def print(self, text: str) -> None:
        """Above the bars, to the standard output."""
        if text:
            print(text, flush=True)


@contextlib.contextmanager
def progress() -> Iterator[Bars]:
    """Bars with rate and time left, on a terminal."""
    columns = (TextColumn('{task.description}', markup=False), BarColumn(), MofNCompleteColumn(), _RateColumn(),
               TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bars:
        yield Bars(bars)
