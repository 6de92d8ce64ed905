"""What `svdm tune` carries out: its scenes or pairs, the judge, and the way through the parameters."""
from __future__ import annotations

import argparse
import contextlib
from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any, NamedTuple

from ..evaluation.aligned_scenes import SceneAligner
from ..evaluation.datasets import StereoScene
from ..evaluation.recordings import pair_sources
from ..evaluation.scene_sets import RESOLUTIONS, find_scenes
from ..parameters import MatcherParameters
from ..presets import preset_values
from ..tuning.climb import climb
from ..tuning.image_pair import AnyPair
from ..tuning.importance import importances
from ..tuning.judges import Judge, TruthJudge, UnsupervisedJudge
from ..tuning.ladders import at_their_defaults, ladders
from ..tuning.optimization import Evaluator, joint_search, one_at_a_time
from ..tuning.pair_choice import choose_pairs
from ..tuning.ranges import ParameterRange, check_tunable, once_each, paper_ranges, parse_range
from ..tuning.store import FigureStore
from .options import parameters_of, parse_changes

if TYPE_CHECKING:
    from ..tuning.proof import Proof
    from ..tuning.report import Study  # needs rich

UNSUPERVISED = 'unsupervised'
_TRIALS = 40
"""Of a search without ground truth: more would be led astray."""
_PAIRS = 8
"""Chosen, where --pairs does not say how many."""
_SEARCH_RANGE = ('min_disparity', 'num_disparities')


class _Material(NamedTuple):
    """What is tuned on, and how it is judged. rows: what right images were aligned by, None where nothing was asked."""

    pairs: Sequence[AnyPair]
    judge: Judge
    objective: str
    rows: dict[str, Any] | None
    notes: Sequence[str] = ()


def made_study(options: argparse.Namespace) -> Study:
    """ValueError, OSError or ImportError with one line."""
    from ..tuning.report import Study

    ranges = _ranges(options)
    unsupervised = options.objective == UNSUPERVISED
    check_tunable(name for name in parse_changes(options.changes) if not (unsupervised and name in _SEARCH_RANGE))
    if options.preset is None:
        options.preset = 'paper_start' if options.study else 'default'
    parameters = parameters_of(options)
    material = _pairs(options, parameters) if unsupervised else _scenes(options)
    trials = options.search or (_TRIALS if unsupervised and not options.vary else None)
    climbs = trials is not None and not options.vary
    sets = trials if trials is not None and not options.importance else sum(len(entry.values) for entry in ranges)
    with _progress(len(material.pairs) * (1 + sets)) as advance:
        evaluate = Evaluator(material.pairs, material.judge, options.threads, FigureStore(options.storage), advance)
        start = evaluate(parameters)
        study = Study(evaluate, material.objective, start, [], [], [entry.name for entry in ranges],
                      against_paper=bool(options.study), climbed=climbs, row_alignment=material.rows,
                      notes=material.notes)
        if options.importance:
            return study.with_found(importances=importances(evaluate, start, ranges, material.objective))
        if climbs:
            return _climbed(study, ranges, trials or 1)
        if trials is None:
            return study.with_found(steps=one_at_a_time(evaluate, start, ranges, material.objective))
        return study.with_found(trials=joint_search(evaluate, start, ranges, trials, material.objective))


def _climbed(study: Study, ranges: Sequence[ParameterRange], trials: int) -> Study:
    """From the defaults of all that has steps, where those are better than the start; they are the first trial."""
    parameters = at_their_defaults(study.start.parameters)
    if parameters == study.start.parameters:
        return study.with_found(steps=climb(study.evaluate, study.start, ranges, trials, study.objective))
    defaults = study.evaluate(parameters)
    begin = min(study.start, defaults, key=lambda evaluation: evaluation.average[study.objective])
    steps = climb(study.evaluate, begin, ranges, trials - 1, study.objective) if trials > 1 else []
    return study.with_found(steps=steps, defaults=defaults)


def made_proof(options: argparse.Namespace, count: int) -> Proof:
    """Of the scenes with ground truth. Raises as `made_study`."""
    from ..tuning.proof import BothJudges, Proof, spread_sets

    scenes, factor = _read(options, None)
    sets = spread_sets(count)
    with _progress(len(scenes) * len(sets)) as advance:
        judge = BothJudges(factor, options.threads)
        evaluate = Evaluator(scenes, judge, options.threads, FigureStore(options.storage), advance)
        return Proof.of(sets, [evaluate(one.parameters) for one in sets])


def _ranges(options: argparse.Namespace) -> list[ParameterRange]:
    if options.study:
        return paper_ranges()
    if not options.vary:
        return ladders()
    ranges = [parse_range(text) for text in options.vary]
    if options.search is not None:
        once_each(ranges)
    return ranges


def _scenes(options: argparse.Namespace) -> _Material:
    aligner = SceneAligner() if options.align_rows else None
    scenes, factor = _read(options, aligner)
    return _Material(scenes, TruthJudge(factor), options.objective, None if aligner is None else aligner.document())


def _read(options: argparse.Namespace, aligner: SceneAligner | None) -> tuple[list[StereoScene], float]:
    """The scenes, and full-resolution px per px of their images."""
    scene_set = find_scenes(options.folder).chosen(options.scenes)
    factor = RESOLUTIONS[scene_set.resolution(options.resolution)]
    scenes = [read() if aligner is None else aligner.aligned(read()) for read in scene_set.readers.values()]
    return scenes, factor


def _pairs(options: argparse.Namespace, parameters: MatcherParameters) -> _Material:
    sources = pair_sources([options.folder], (options.left, options.right), options.calib)
    given = {*preset_values(options.params or options.preset), *parse_changes(options.changes)}
    number = parameters.num_disparities if 'num_disparities' in given else None
    search = parameters.min_disparity, number
    chosen = choose_pairs(sources, options.pairs or _PAIRS, search, align_rows=options.align_rows)
    rows = {name: found and found.as_dict() for name, found in chosen.rows.items()}
    judge = UnsupervisedJudge(options.threads)
    return _Material(chosen.pairs, judge, 'loss', rows if options.align_rows else None, chosen.notes)


@contextlib.contextmanager
def _progress(maps: int) -> Iterator[Callable[[], None]]:
    """A progress bar over the maps; yields what moves it on by one."""
    from rich.console import Console
    from rich.progress import Progress

    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task('matching', total=maps)
        yield lambda: bar.advance(task)
