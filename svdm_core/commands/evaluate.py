"""`svdm evaluate`: svdm and OpenCV over scenes with ground truth."""
from __future__ import annotations

import argparse
import json
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ..evaluation.aligned_scenes import SceneAligner, alignment_line
from ..evaluation.confidence_fit import check_fit_scenes, fit_lines
from ..evaluation.datasets import StereoScene
from ..evaluation.metric_names import check_metrics, default_metrics
from ..evaluation.scene_evaluation import (
    METHODS,
    OWN_METHOD,
    Contender,
    Evaluation,
    JudgedScene,
    evaluate,
    parse_methods,
    summary,
)
from ..evaluation.scene_sets import RESOLUTIONS, SceneSet, find_scenes
from ..evaluation.trust_report import TrustReport, confidence_lines
from ..files.output_files import check_outputs, write_outputs
from ..shown import line
from .options import add_align_rows_option, add_parameter_options, add_threads_option, parameters_of, parse_changes

if TYPE_CHECKING:
    from ..evaluation.page import EvaluationPage


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The scenes, the contenders, and what is written."""
    parser.add_argument('folder', type=Path, metavar='FOLDER', help='scenes in the layout of Middlebury v3 or KITTI')
    add_parameter_options(parser)
    parser.add_argument('--method', action='append', dest='methods', metavar='M',
                        help=f'{" | ".join(METHODS)}; several times, or separated by commas (svdm)')
    parser.add_argument('--grey', action='store_true', help='take the colour away first')
    add_align_rows_option(parser)
    parser.add_argument('--resolution', choices=RESOLUTIONS,
                        help='of the images: quarter, half or full (Q; KITTI has F only)')
    parser.add_argument('--scenes', nargs='+', action='extend', default=[], metavar='NAME', help='these only')
    parser.add_argument('--metrics', nargs='+', action='extend', default=[], metavar='NAME',
                        help='columns of the table, in place of those of the benchmark')
    add_threads_option(parser)
    parser.add_argument('--fit-confidence', action='store_true',
                        help='fit the chance of being wrong to the confidence, and test it on scenes left out')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    parser.add_argument('--html', type=Path, metavar='FILE', help='write a page with figures and pictures')
    parser.add_argument('--force', action='store_true', help='overwrite files that exist')


def run(options: argparse.Namespace) -> int:
    """Evaluate, print, and write what was asked for; 1 where a scene had to be left out, else 0."""
    from ..evaluation import table  # needs rich, which the help must do without

    check_outputs([path for path in (options.json, options.html) if path is not None], options.force)
    check_metrics(options.metrics)
    contenders = _contenders(options)
    scene_set = find_scenes(options.folder).chosen(options.scenes)
    if options.fit_confidence:
        _check_fit(contenders, scene_set)
    resolution = scene_set.resolution(options.resolution)
    page = _page(options, RESOLUTIONS[resolution])
    scenes = {name: _grey(read) if options.grey else read for name, read in scene_set.readers.items()}
    aligner = SceneAligner() if options.align_rows else None
    if aligner is not None:
        scenes = {name: aligner.reader(read) for name, read in scenes.items()}
    trust = TrustReport()

    def keep(scene: StereoScene, judged: Mapping[str, JudgedScene]) -> None:
        trust.add(scene, judged)
        if page is not None:
            page.add(scene, judged)

    with table.progress(len(scenes)) as tell:
        result = evaluate(scenes, contenders, RESOLUTIONS[resolution], tell, keep)
    document = _document(options, scene_set, resolution, contenders, (result, trust))
    document['row_alignment'] = None if aligner is None else aligner.document()
    document['confidence_fit'] = trust.fit(OWN_METHOD) if options.fit_confidence else None
    methods = document.get('methods') or {document['method']: document}
    metrics = options.metrics or default_metrics(scene_set.layout)
    table.print_tables(document, methods, metrics)
    if aligner is not None:
        print(alignment_line(document['row_alignment']))
    print(*confidence_lines(methods), sep='\n')
    if options.fit_confidence:
        print(*fit_lines(document['confidence_fit']), sep='\n')
    contents: dict[Path, bytes] = {}
    if options.json is not None:
        contents[options.json] = (json.dumps(document, indent=1, allow_nan=False) + '\n').encode()
    if page is not None:
        contents[options.html] = page.render(document, methods, metrics, scene_set.weights).encode()
    write_outputs(contents, options.force)
    for failure in result.failures:
        print(f'svdm evaluate: left out: {line(failure)}', file=sys.stderr)
    return 1 if result.failures else 0


def _contenders(options: argparse.Namespace) -> list[Contender]:
    parameters = parameters_of(options)
    num_disparities = parameters.num_disparities if 'num_disparities' in parse_changes(options.changes) else None
    methods = parse_methods(options.methods or [OWN_METHOD])
    return [Contender(method, parameters, num_disparities, options.threads) for method in methods]


def _page(options: argparse.Namespace, factor: int) -> EvaluationPage | None:
    if options.html is None:
        return None
    from ..evaluation.page import EvaluationPage  # needs jinja2

    return EvaluationPage(factor)


def _grey(read: Callable[[], StereoScene]) -> Callable[[], StereoScene]:
    return lambda: read().grey()


def _check_fit(contenders: Sequence[Contender], scene_set: SceneSet) -> None:
    """ValueError, before the work, where --fit-confidence cannot be done."""
    if OWN_METHOD not in [contender.method for contender in contenders]:
        raise ValueError(f'--fit-confidence needs {OWN_METHOD} among the methods: OpenCV has no confidence')
    check_fit_scenes(len(scene_set.readers))


def _document(
    options: argparse.Namespace, scene_set: SceneSet, resolution: str, contenders: Sequence[Contender],
    found: tuple[Evaluation, TrustReport],
) -> dict[str, Any]:
    """What --json writes: the first method's figures, and below 'methods' those of each where there are several."""
    result, confidence = found[0], found[1].document()
    methods = {contender.method: {'parameters': contender.settings,
                                  **summary(result.figures[contender.method], scene_set.weights),
                                  'confidence': confidence[contender.method]}
               for contender in contenders}
    first = contenders[0].method
    return {
        'layout': scene_set.layout, 'resolution': resolution, 'pixel_factor': RESOLUTIONS[resolution],
        'grey': options.grey, 'threads': options.threads, 'left_out': result.failures,
        'method': first, **methods[first], **({'methods': methods} if len(methods) > 1 else {}),
    }
