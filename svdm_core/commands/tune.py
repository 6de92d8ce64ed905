"""`svdm tune`: find parameters on images with ground truth, one at a time or jointly."""
from __future__ import annotations

import argparse
import contextlib
import importlib.util
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ..evaluation.aligned_scenes import SceneAligner, alignment_line
from ..evaluation.scene_sets import RESOLUTIONS, find_scenes
from ..files.output_files import check_outputs, write_outputs
from ..missing_modules import not_installed
from ..presets import preset_text
from ..tuning.optimization import FIGURES, Evaluator, joint_search, one_at_a_time
from ..tuning.ranges import ParameterRange, check_tunable, once_each, paper_ranges, parse_range
from ..tuning.store import FigureStore
from .argument_types import count
from .options import add_align_rows_option, add_parameter_options, add_threads_option, parameters_of, parse_changes

if TYPE_CHECKING:
    from ..tuning import report  # needs rich

_EPILOG = '''Without --search the parameters are varied one after the other, each from the best so far. A parameter may
be given twice, coarse and then fine. --study paper starts from preset paper_start.'''


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.epilog = _EPILOG
    parser.add_argument('folder', type=Path, metavar='FOLDER', help='scenes in the layout of Middlebury v3 or KITTI')
    what = parser.add_mutually_exclusive_group(required=True)
    what.add_argument('--vary', action='append', metavar='NAME=VALUES', help='alpha=10:11:0.1 or w_p=11,21,31')
    what.add_argument('--study', choices=('paper',), help="the ranges of the paper's Tables 2 to 5, its figures beside")
    parser.add_argument('--search', type=count, metavar='N', help='search jointly, N trials (needs optuna)')
    parser.add_argument('--objective', choices=FIGURES, default=FIGURES[0], help='what to make small (%(default)s)')
    add_parameter_options(parser)
    parser.set_defaults(preset=None)
    parser.add_argument('--scenes', nargs='+', action='extend', default=[], metavar='NAME', help='these only')
    add_align_rows_option(parser)
    parser.add_argument('--resolution', choices=RESOLUTIONS,
                        help='of the images: quarter, half or full (Q; KITTI has F only)')
    add_threads_option(parser)
    parser.add_argument('--storage', type=Path, metavar='FILE',
                        help='keep what is computed here; a run that is started again goes on from it')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all figures')
    parser.add_argument('--html', type=Path, metavar='FILE', help='write a page with plots and maps')
    parser.add_argument('--best', type=Path, metavar='FILE.yaml', help='write the best parameters as a preset')
    parser.add_argument('--force', action='store_true', help='overwrite the files written')


def run(options: argparse.Namespace) -> int:
    """Tune, print a table, write what was asked for; 0. ValueError, OSError or ImportError with one line."""
    _check_files(options)
    ranges = _ranges(options)
    _check_modules(options)
    study = _study(options, ranges)
    from ..tuning import report

    report.print_table(study)
    print(f'{study.evaluate.maps} maps were computed')
    if study.row_alignment is not None:
        print(alignment_line(study.row_alignment))
    texts = {}
    if options.json:
        texts[options.json] = json.dumps(report.document(study), indent=1) + '\n'
    if options.html:
        from ..tuning import page
        texts[options.html] = page.page(study)
    if options.best:
        texts[options.best] = preset_text(study.best.parameters, _when_to_take(study))
    write_outputs({path: text.encode() for path, text in texts.items()}, options.force)
    return 0


def _ranges(options: argparse.Namespace) -> list[ParameterRange]:
    ranges = paper_ranges() if options.study else [parse_range(text) for text in options.vary]
    if options.search is not None:
        once_each(ranges)
    return ranges


def _study(options: argparse.Namespace, ranges: list[ParameterRange]) -> report.Study:
    from ..tuning.report import Study

    check_tunable(parse_changes(options.changes))
    if options.preset is None:
        options.preset = 'paper_start' if options.study else 'default'
    parameters = parameters_of(options)
    scene_set = find_scenes(options.folder).chosen(options.scenes)
    factor = RESOLUTIONS[scene_set.resolution(options.resolution)]
    aligner = SceneAligner() if options.align_rows else None
    scenes = [read() if aligner is None else aligner.aligned(read()) for read in scene_set.readers.values()]
    store = FigureStore(options.storage)
    with _progress(len(scenes) * (1 + _sets(ranges, options.search))) as advance:
        evaluate = Evaluator(scenes, factor, options.threads, store, advance)
        start = evaluate(parameters)
        steps, trials = [], []
        if options.search is None:
            steps = one_at_a_time(evaluate, start, ranges, options.objective)
        else:
            trials = joint_search(evaluate, start, ranges, options.search, options.objective)
    return Study(evaluate, options.objective, start, steps, trials, [entry.name for entry in ranges],
                 against_paper=bool(options.study), row_alignment=None if aligner is None else aligner.document())


def _check_files(options: argparse.Namespace) -> None:
    """Refuse what could not be written at the end."""
    outputs = [path for path in (options.json, options.html, options.best) if path]
    check_outputs(outputs, options.force)
    if options.best and options.best.suffix not in ('.yaml', '.yml'):
        raise ValueError(f'{options.best}: a preset is read from a .yaml file only: name it so')
    if options.storage:
        check_outputs([options.storage], force=True)
        if options.storage.absolute() in [path.absolute() for path in outputs]:
            raise ValueError(f'{options.storage} is the storage: write something else to another file')


def _check_modules(options: argparse.Namespace) -> None:
    needed = ['rich', *(['optuna'] if options.search is not None else []),
              *(['jinja2', 'matplotlib'] if options.html else [])]
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        raise ImportError(not_installed(missing))


def _when_to_take(study: report.Study) -> str:
    names = [scene.name for scene in study.evaluate.scenes]
    scenes = ', '.join(names) if len(names) <= 3 else f'{len(names)} scenes, {names[0]} to {names[-1]}'
    error = f'{study.objective} {study.best.average[study.objective]:.2f}'
    return f'Take this one for images like those it was tuned on: {scenes}; {error} there.'


def _sets(ranges: list[ParameterRange], trials: int | None) -> int:
    return sum(len(entry.values) for entry in ranges) if trials is None else trials


@contextlib.contextmanager
def _progress(maps: int) -> Iterator[Callable[[], None]]:
    """A progress bar over the maps; yields what moves it on by one."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task('matching', total=maps)
        yield lambda: bar.advance(task)
