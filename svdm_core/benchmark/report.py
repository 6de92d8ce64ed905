"""Shows what the benchmark measured: a table, and a plot."""
from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterator, Mapping
from typing import Any

from rich.console import Console
from rich.progress import Progress
from rich.table import Table

from ..missing_modules import not_installed
from .contenders import is_own

_WIDTH = 160  # characters, where the output is no terminal


@contextlib.contextmanager
def progress(rounds: int, what: str = 'timing the contenders in turn') -> Iterator[Callable[[], None]]:
    """A progress bar over the timed rounds; yields what moves it on by one."""
    with Progress(console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task(what, total=rounds)
        yield lambda: bar.advance(task)


def print_table(document: Mapping[str, Any], console: Console | None = None) -> None:
    """One row a contender: time, ratio to each of OpenCV's methods, accuracy, memory; several tables if too wide."""
    console = console or output_console()
    width, height = document['size']
    kind = 'colour' if document['colour'] else 'grey'
    title = f'{width}x{height} {kind}, {document["disparities"]} disparities, {document["threads"]} threads'
    names = list(document['contenders'])
    for columns in _side_by_side(['', *names], _columns(document), console.width):
        table = Table(title=title)
        for number, column in enumerate(columns):
            table.add_column(column[0], justify='right' if number else 'left', no_wrap=True, min_width=_width(column))
        for cells in list(zip(*columns, strict=True))[1:]:
            table.add_row(*cells)
        console.print(table)
        title = ''
    for name, value in document['contenders'].items():
        if value['stages_ms']:
            stages = ', '.join(f'{stage} {ms:.1f}' for stage, ms in value['stages_ms'].items() if stage != 'total')
            console.print(f'{name}: {stages} ms', soft_wrap=True)


def _columns(document: Mapping[str, Any]) -> list[list[str]]:
    """The columns behind the names, a heading and the cells each: what is looked at first comes first."""
    contenders = document['contenders']
    values = list(contenders.values())
    columns = [['ms', *(f'{value["median_ms"]:.1f}' for value in values)]]
    for other in filter(lambda name: not is_own(name), contenders):
        columns.append([f'x {other}', *(f'{document["ratios"][name][other]:.2f}' for name in contenders)])
    if all('avgerr' in value for value in values):
        columns.append(['avgerr px', *(f'{value["avgerr"]:.2f}' for value in values)])
        columns.append(['bad2 %', *(f'{value["bad2"]:.1f}' for value in values)])
    columns.append(['MDE/s a core', *(f'{value["mde_per_s_core"]:.0f}' for value in values)])
    columns.append(['work', *(value['work'] for value in values)])
    columns.append(['extra MB', *(f'{value["extra_mb"]:.0f}' for value in values)])
    columns.append(['quartiles', *(f'{value["low_ms"]:.1f}-{value["high_ms"]:.1f}' for value in values)])
    columns.append(['MDE/s', *(f'{value["mde_per_s"]:.0f}' for value in values)])
    return columns


def _side_by_side(names: list[str], columns: list[list[str]], width: int) -> list[list[list[str]]]:
    """The columns of each table: the names, and as many of the others as fit."""
    tables = [[names]]
    for column in columns:
        # A border of one and a space either side, for each column, and the last border.
        if len(tables[-1]) > 1 and sum(_width(other) + 3 for other in (*tables[-1], column)) + 1 > width:
            tables.append([names])
        tables[-1].append(column)
    return tables


def _width(column: list[str]) -> int:
    return max(map(len, column))


def print_scaling(scaling: Mapping[str, Any]) -> None:
    """Times over sizes and over disparities, and the exponents with which they grow."""
    for name, value in scaling.items():
        for kind, key, exponent in (('pixels', 'size_ms', 'pixel_exponent'),
                                    ('disparities', 'disparities_ms', 'disparity_exponent')):
            times = ', '.join(f'{case} {ms:.0f} ms' for case, ms in value[key].items())
            output_console().print(f'{name}: time grows with {kind} to the power {value[exponent]:.2f} ({times})',
                             soft_wrap=True)


def check_picture(suffix: str) -> None:
    """Raises ValueError where matplotlib writes no such files, ImportError where it is not installed."""
    try:
        from matplotlib.backend_bases import FigureCanvasBase
    except ImportError:
        raise ImportError(f'{not_installed(["matplotlib"])}; or leave the picture out') from None

    known = sorted(FigureCanvasBase.get_supported_filetypes())
    if suffix.lower().removeprefix('.') not in known:
        raise ValueError(f'the suffix {suffix!r} is not allowed: a picture is one of .{", .".join(known)}')


def draw(document: Mapping[str, Any], suffix: str) -> bytes:
    """A picture of time against the share of pixels off by more than 2 px; needs figures with accuracy."""
    import matplotlib

    matplotlib.use('Agg')
    from matplotlib import pyplot as plt

    figure, ax = plt.subplots(figsize=(8, 5), layout='constrained')
    for name, value in document['contenders'].items():
        own = is_own(name)
        spread = [[value['median_ms'] - value['low_ms']], [value['high_ms'] - value['median_ms']]]
        ax.errorbar(value['median_ms'], value['bad2'], xerr=spread, fmt='o' if own else 's',
                    color='tab:red' if own else 'tab:blue')
        ax.annotate(name, (value['median_ms'], value['bad2']), xytext=(6, 6), textcoords='offset points')
    width, height = document['size']
    ax.set(xlabel='time for one pair (ms), quartiles', ylabel='pixels off by more than 2 px (%)', xscale='log',
           title=f'{width}x{height}, {document["disparities"]} disparities, {document["threads"]} threads')
    ax.margins(0.15)
    ax.grid(alpha=0.3, which='both')
    picture = io.BytesIO()
    figure.savefig(picture, dpi=120, format=suffix.lower().removeprefix('.'))
    plt.close(figure)
    return picture.getvalue()


def output_console() -> Console:
    """Where tables go: as wide as the terminal, or as a file can well be."""
    console = Console()
    return console if console.is_terminal else Console(width=_WIDTH)
