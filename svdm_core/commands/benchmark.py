"""`svdm benchmark`: the presets beside OpenCV's matchers, and how they would do on more threads."""
from __future__ import annotations

import argparse
import itertools
import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from ..benchmark import runs
from ..benchmark.contenders import all_methods, contender_names, is_own, parameters_of, why_not_modelled
from ..benchmark.limits import check_limits
from ..files.images import read_image
from ..files.output_files import check_outputs, write_outputs
from ..missing_modules import not_installed
from ..parameters import parameter_info
from .argument_types import count, size, thread_counts
from .options import disparities

SCALING_SIZES = ((320, 240), (640, 480), (1280, 720), (1920, 1080))
SCALING_DISPARITIES = (32, 64, 128, 256)
SCALING_ROUNDS = 7
# Sizes with 64 disparities, and disparities with 640x480.
SCALING_CASES: tuple[list[tuple[tuple[int, int], int]], ...] = (
    [(each, 64) for each in SCALING_SIZES],
    [((640, 480), each) for each in SCALING_DISPARITIES],
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Images, sizes, rounds, and what is written."""
    allowed = parameter_info('num_disparities').allowed
    parser.add_argument('--methods', type=lambda text: text.split(','), metavar='M,...',
                        help='presets, .yaml files and OpenCV methods, separated by commas; of a file, all but '
                             'num_disparities (all presets, bm, sgbm-3way, sgbm-hh4, sgbm-hh)')
    parser.add_argument('--size', type=size, default=(640, 480), metavar='WxH', help='image size (640x480)')
    parser.add_argument('--disparities', type=disparities, default=64, metavar='D',
                        help=f'disparities searched, {allowed}, and below the width (64)')
    parser.add_argument('--threads', type=count, default=2, metavar='N',
                        help='threads of each contender, at most one a processor (2)')
    parser.add_argument('--rounds', type=count, default=15, metavar='N', help='timed rounds, contenders in turn (15)')
    colour = parser.add_mutually_exclusive_group()
    colour.add_argument('--mono', dest='colour', action='store_false', help='grey images (the default)')
    colour.add_argument('--colour', action='store_true', help='colour images')
    parser.add_argument('--pair', type=Path, nargs=2, metavar=('LEFT', 'RIGHT'),
                        help='a rectified pair, scaled to --size; without it the Motorcycle of scikit-image, which has '
                             'ground truth')
    parser.add_argument('--scaling', action='store_true',
                        help='also sweep 320x240 to 1920x1080 with 64 disparities, and 32 to 256 disparities with '
                             f'640x480, and fit exponents: {SCALING_ROUNDS} rounds each, whatever --size, '
                             '--disparities and --rounds say')
    parser.add_argument('--model-threads', type=thread_counts, metavar='N,...',
                        help='also model, from the times of single tasks, a frame on so many threads, such as '
                             '1,2,4,8,16, whether this machine has them or not')
    parser.add_argument('--plot', type=Path, metavar='FILE',
                        help='draw the speed-up of the model over its threads (needs matplotlib and --model-threads)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    parser.add_argument('--png', type=Path, metavar='FILE',
                        help='draw time against accuracy (needs matplotlib; not with --pair)')
    parser.add_argument('--force', action='store_true', help='overwrite files that exist')
    parser.set_defaults(colour=False)


def run(options: argparse.Namespace) -> int:
    """Measure, print, and write what was asked for; 0."""
    from ..benchmark import report  # needs rich, which the help must do without

    names = contender_names(options.methods or all_methods())
    _check(options, names)
    threads = runs.usable_threads(options.threads)
    if threads < options.threads:
        print(f'svdm benchmark: --threads {options.threads} is more than there are processors: {threads} taken',
              file=sys.stderr)
    whole = _read_pair(*options.pair) if options.pair else _motorcycle()
    whole = whole if options.colour else whole.grey()
    pair = whole.scaled(*options.size)
    with report.progress(options.rounds) as advance:
        figures = runs.run_benchmark(pair, names, options.disparities, threads,
                                     options.rounds, advance)
    document: dict[str, Any] = {
        'size': list(options.size), 'disparities': options.disparities, 'threads': threads, 'rounds': options.rounds,
        'colour': options.colour, 'contenders': figures, 'ratios': runs.ratios(figures),
    }
    report.print_table(document)
    if busy := runs.busy_line(figures):
        print(f'svdm benchmark: {busy}', file=sys.stderr)
    if options.scaling:
        document['scaling'] = _scaling(whole, list(filter(is_own, names)), threads)
        report.print_scaling(document['scaling'])
    if options.model_threads:
        document['model'] = _model(pair, list(filter(is_own, names)), options)
    write_outputs(_contents(options, document), options.force)
    return 0


def _contents(options: argparse.Namespace, document: dict[str, Any]) -> dict[Path, bytes]:
    """What is to be written."""
    from ..benchmark import model_report, report

    contents: dict[Path, bytes] = {}
    if options.json is not None:
        contents[options.json] = (json.dumps(document, indent=1) + '\n').encode()
    if options.png is not None:
        contents[options.png] = report.draw(document, options.png.suffix)
    if options.plot is not None:
        contents[options.plot] = model_report.draw_model(document, options.plot.suffix)
    return contents


def _check(options: argparse.Namespace, names: list[str]) -> None:
    """Refuse before the run what would fail in it or after it."""
    from ..benchmark import report

    pictures = [path for path in (options.png, options.plot) if path is not None]
    check_outputs([*([options.json] if options.json is not None else []), *pictures], options.force)
    if options.png is not None and options.pair:
        raise ValueError('--png needs a pair with ground truth: leave out --pair')
    if options.plot is not None and not options.model_threads:
        raise ValueError('--plot draws the model: give --model-threads as well, such as 1,2,4,8,16')
    for path in pictures:
        try:
            report.check_picture(path.suffix)
        except ValueError as error:
            raise ValueError(f'{path}: {error}') from None
    own = list(filter(is_own, names))
    if options.scaling and not own:
        raise ValueError('--scaling sweeps presets and parameter files: --methods names none')
    if options.model_threads and all(why_not_modelled(parameters_of(name)) for name in own):
        raise ValueError('--model-threads: none of --methods can be modelled; fast and default can')
    cases = [(options.size, options.disparities), *(itertools.chain(*SCALING_CASES) if options.scaling else ())]
    for (width, height), num_disparities in cases:
        check_limits(width, height, num_disparities)


def _model(pair: runs.BenchmarkPair, names: list[str], options: argparse.Namespace) -> dict[str, Any]:
    """The work-span model of each contender, or why there is none; printed too."""
    from ..benchmark import model_report, report
    from ..benchmark.model import measure_model

    reasons = {name: why_not_modelled(parameters_of(name)) for name in names}
    result: dict[str, Any] = {}
    with report.progress(options.rounds * sum(not reason for reason in reasons.values()), 'timing tasks') as advance:
        for name, reason in reasons.items():
            parameters = parameters_of(name).replace(num_disparities=options.disparities)
            result[name] = {'not_modelled': reason} if reason else measure_model(
                pair, parameters, options.model_threads, options.rounds, advance)
    model_report.print_model({'model': result, 'size': options.size, 'colour': options.colour,
                              'disparities': options.disparities})
    if busy := runs.busy_line({name: value for name, value in result.items() if 'rows' in value}):
        print(f'svdm benchmark: {busy}', file=sys.stderr)
    return result


def _scaling(whole: runs.BenchmarkPair, names: list[str], threads: int) -> dict[str, Any]:
    """Median ms of each own contender over image sizes (64 disparities) and over disparities (640x480), with exponents.

    The sizes are cut from the 640x480 images or tiled with them: scaled images would have other disparities.
    """
    from ..benchmark import report

    vga = whole.scaled(640, 480)
    rounds = SCALING_ROUNDS * sum(map(len, SCALING_CASES))
    with report.progress(rounds, 'sweeping sizes and disparities') as advance:
        by_size, by_disparities = (
            [runs.run_benchmark(vga.tiled(*image_size), names, num_disparities, threads, SCALING_ROUNDS, advance,
                                memory=False)
             for image_size, num_disparities in cases]
            for cases in SCALING_CASES
        )
    pixels = [width * height for width, height in SCALING_SIZES]
    result: dict[str, Any] = {}
    for name in names:
        over_size = [figures[name]['median_ms'] for figures in by_size]
        over_disparities = [figures[name]['median_ms'] for figures in by_disparities]
        result[name] = {
            'size_ms': {f'{w}x{h}': ms for (w, h), ms in zip(SCALING_SIZES, over_size, strict=True)},
            'disparities_ms': {str(d): ms for d, ms in zip(SCALING_DISPARITIES, over_disparities, strict=True)},
            'pixel_exponent': runs.growth(pixels, over_size),
            'disparity_exponent': runs.growth(SCALING_DISPARITIES, over_disparities),
        }
    return result


def _read_pair(left: Path, right: Path) -> runs.BenchmarkPair:
    images = [read_image(path) for path in (left, right)]
    if images[0].shape != images[1].shape:
        raise ValueError(f'{left} and {right} have different sizes: {images[0].shape[:2]} and {images[1].shape[:2]}')
    return runs.BenchmarkPair(images[0], images[1])


def _motorcycle() -> runs.BenchmarkPair:
    try:
        from skimage.data import stereo_motorcycle
    except ImportError:
        raise ImportError(f'{not_installed(["skimage"])}; or give a pair of your own with --pair') from None
    left, right, truth = cast(Callable[[], tuple[Any, Any, Any]], stereo_motorcycle)()
    return runs.BenchmarkPair(left[..., ::-1].copy(), right[..., ::-1].copy(), truth)
