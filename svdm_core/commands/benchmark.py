"""`svdm benchmark`: the presets beside OpenCV's matchers."""
from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

from .. import benchmark
from ..evaluation.datasets import read_image
from ..presets import preset_names
from .options import count

SCALING_SIZES = ((320, 240), (640, 480), (1280, 720), (1920, 1080))
SCALING_DISPARITIES = (32, 64, 128, 256)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Images, sizes, rounds, and what is written."""
    parser.add_argument('--size', type=_size, default=(640, 480), metavar='WxH', help='image size (640x480)')
    parser.add_argument('--disparities', type=count, default=64, help='disparities searched (64)')
    parser.add_argument('--threads', type=count, default=2, help='threads of each contender (2)')
    parser.add_argument('--rounds', type=count, default=15, help='timed rounds, contenders in turn (15)')
    colour = parser.add_mutually_exclusive_group()
    colour.add_argument('--mono', dest='colour', action='store_false', help='grey images (the default)')
    colour.add_argument('--colour', action='store_true', help='colour images')
    parser.add_argument('--pair', type=Path, nargs=2, metavar=('LEFT', 'RIGHT'),
                        help='a rectified pair; without it the Motorcycle of scikit-image, which has ground truth')
    parser.add_argument('--scaling', action='store_true', help='also sweep sizes and disparities, and fit exponents')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    parser.add_argument('--png', type=Path, metavar='FILE', help='draw time against accuracy (needs matplotlib)')
    parser.set_defaults(colour=False)


def _size(text: str) -> tuple[int, int]:
    width, _, height = text.partition('x')
    try:
        return count(width), count(height)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f'{text!r} is not a size: write it as 640x480') from None


def run(options: argparse.Namespace) -> int:
    """Measure, print, and write what was asked for; 0."""
    from .. import benchmark_report  # needs rich, which the help must do without

    for path in (options.json, options.png):
        if path is not None and path.exists():
            raise ValueError(f'{path} exists already: remove it, or name another file')
    whole = _read_pair(*options.pair) if options.pair else _motorcycle()
    whole = whole if options.colour else whole.grey()
    names = benchmark.contender_names(preset_names())
    with benchmark_report.progress(options.rounds) as advance:
        figures = benchmark.run_benchmark(whole.scaled(*options.size), names, options.disparities, options.threads,
                                          options.rounds, advance)
    document: dict[str, Any] = {
        'size': list(options.size), 'disparities': options.disparities, 'threads': options.threads,
        'colour': options.colour, 'contenders': figures, 'ratios': benchmark.ratios(figures),
    }
    benchmark_report.print_table(document)
    if options.scaling:
        document['scaling'] = _scaling(whole, options.threads)
        benchmark_report.print_scaling(document['scaling'])
    if options.json is not None:
        options.json.write_text(json.dumps(document, indent=1) + '\n')
    if options.png is not None:
        benchmark_report.draw(document, options.png)
    return 0


def _scaling(whole: benchmark.BenchmarkPair, threads: int) -> dict[str, Any]:
    """Median ms of each preset over image sizes (64 disparities) and over disparities (640x480), with exponents.

    The sizes are cut from the 640x480 images or tiled with them: scaled images would have other disparities.
    """
    vga = whole.scaled(640, 480)
    names = [name for name in benchmark.contender_names(preset_names()) if name.startswith('svdm-')]
    by_size, by_disparities = (
        [benchmark.run_benchmark(vga.tiled(*size), names, disparities, threads, rounds=7, memory=False)
         for size, disparities in cases]
        for cases in ([(size, 64) for size in SCALING_SIZES], [((640, 480), d) for d in SCALING_DISPARITIES])
    )
    pixels = [width * height for width, height in SCALING_SIZES]
    result: dict[str, Any] = {}
    for name in names:
        over_size = [figures[name]['median_ms'] for figures in by_size]
        over_disparities = [figures[name]['median_ms'] for figures in by_disparities]
        result[name] = {
            'size_ms': {f'{w}x{h}': ms for (w, h), ms in zip(SCALING_SIZES, over_size, strict=True)},
            'disparities_ms': {str(d): ms for d, ms in zip(SCALING_DISPARITIES, over_disparities, strict=True)},
            'pixel_exponent': benchmark.growth(pixels, over_size),
            'disparity_exponent': benchmark.growth(SCALING_DISPARITIES, over_disparities),
        }
    return result


def _read_pair(left: Path, right: Path) -> benchmark.BenchmarkPair:
    images = [read_image(path) for path in (left, right)]
    if images[0].shape != images[1].shape:
        raise ValueError(f'{left} and {right} have different sizes: {images[0].shape[:2]} and {images[1].shape[:2]}')
    return benchmark.BenchmarkPair(images[0], images[1])


def _motorcycle() -> benchmark.BenchmarkPair:
    try:
        from skimage.data import stereo_motorcycle
    except ImportError:
        raise ImportError('scikit-image is not installed, which carries the pair: give one with --pair') from None
    left, right, truth = cast(Callable[[], tuple[Any, Any, Any]], stereo_motorcycle)()
    return benchmark.BenchmarkPair(left[..., ::-1].copy(), right[..., ::-1].copy(), truth)
