"""Shows what the benchmark measured: a table, and a plot."""
from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from .evaluation.opencv_matchers import OPENCV_METHODS

_WIDTH = 130  # characters, where the output is no terminal


@contextlib.contextmanager
def progress(rounds: int) -> Iterator[Callable[[], None]]:
    """A progress bar over the timed rounds; yields what moves it on by one."""
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task('timing the contenders in turn', total=rounds)
        yield lambda: bar.advance(task)


def print_table(document: Mapping[str, Any]) -> None:
    """One row a contender: time, ratio to each of OpenCV's methods, memory, accuracy."""
    width, height = document['size']
    kind = 'colour' if document['colour'] else 'grey'
    table = Table(title=f'{width}x{height} {kind}, {document["disparities"]} disparities, '
                        f'{document["threads"]} threads')
    has_accuracy = all('avgerr' in value for value in document['contenders'].values())
    columns = ['ms', 'quartiles', 'MDE/s', *(f'x {name}' for name in OPENCV_METHODS), 'extra MB']
    for column in ('', *columns, *(('avgerr px', 'bad2 %') if has_accuracy else ())):
        table.add_column(column, justify='right' if column else 'left', no_wrap=True)
    for name, value in document['contenders'].items():
        cells = [f'{value["median_ms"]:.1f}', f'{value["low_ms"]:.1f}-{value["high_ms"]:.1f}',
                 f'{value["mde_per_s"]:.0f}', *(f'{document["ratios"][name][other]:.2f}' for other in OPENCV_METHODS),
                 f'{value["extra_mb"]:.0f}']
        if has_accuracy:
            cells += [f'{value["avgerr"]:.2f}', f'{value["bad2"]:.1f}']
        table.add_row(name, *cells)
    _console().print(table)
    for name, value in document['contenders'].items():
        if value['stages_ms']:
            stages = ', '.join(f'{stage} {ms:.1f}' for stage, ms in value['stages_ms'].items() if stage != 'total')
            _console().print(f'{name}: {stages} ms', soft_wrap=True)


def print_scaling(scaling: Mapping[str, Any]) -> None:
    """Times over sizes and over disparities, and the exponents with which they grow."""
    for name, value in scaling.items():
        for kind, key, exponent in (('pixels', 'size_ms', 'pixel_exponent'),
                                    ('disparities', 'disparities_ms', 'disparity_exponent')):
            times = ', '.join(f'{case} {ms:.0f} ms' for case, ms in value[key].items())
            _console().print(f'{name}: time grows with {kind} to the power {value[exponent]:.2f} ({times})',
                             soft_wrap=True)


def draw(document: Mapping[str, Any], path: Path) -> None:
    """A PNG of time against the share of pixels off by more than 2 px. ValueError without ground truth."""
    contenders = document['contenders']
    if any('bad2' not in value for value in contenders.values()):
        raise ValueError('--png needs a pair with ground truth: leave out --pair')
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    figure, ax = plt.subplots(figsize=(8, 5), layout='constrained')
    for name, value in contenders.items():
        own = name.startswith('svdm-')
        spread = [[value['median_ms'] - value['low_ms']], [value['high_ms'] - value['median_ms']]]
        ax.errorbar(value['median_ms'], value['bad2'], xerr=spread, fmt='o' if own else 's',
                    color='tab:red' if own else 'tab:blue')
        ax.annotate(name, (value['median_ms'], value['bad2']), xytext=(6, 6), textcoords='offset points')
    width, height = document['size']
    ax.set(xlabel='time for one pair (ms), quartiles', ylabel='pixels off by more than 2 px (%)', xscale='log',
           title=f'{width}x{height}, {document["disparities"]} disparities, {document["threads"]} threads')
    ax.margins(0.15)
    ax.grid(alpha=0.3, which='both')
    figure.savefig(path, dpi=120)
    plt.close(figure)


def _console() -> Console:
    console = Console()
    return console if console.is_terminal else Console(width=_WIDTH)
