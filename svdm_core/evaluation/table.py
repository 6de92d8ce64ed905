"""Shows an evaluation on the terminal: the progress, and a table a region."""
from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from rich.console import Console
from rich.markup import escape
from rich.progress import Progress
from rich.table import Table

from ..shown import cut
from .metric_names import OF_THE_MAP, REGION_TITLES, unit, written
from .scene_evaluation import REGIONS

_WIDTH = 140  # characters, where the output is no terminal


@contextlib.contextmanager
def progress(total: int) -> Iterator[Callable[[str], None]]:
    """A progress bar over `total` steps; yields what tells the next one."""
    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task('compiling the kernels', total=total + 1)

        def tell(what: str) -> None:
            bar.update(task, advance=1, description=escape(cut(what)))

        yield tell


def print_tables(document: Mapping[str, Any], methods: Mapping[str, Any], metrics: Sequence[str]) -> None:
    """A table a region, one row a scene and method; below them the weighted averages."""
    console = Console()
    console = console if console.is_terminal else Console(width=_WIDTH)
    for region in REGIONS:
        table = Table(title=f'{document["layout"]}, {REGION_TITLES[region]}, errors in full-resolution px')
        for column in ('scene', 'method'):
            table.add_column(column, no_wrap=True)
        for metric in (*metrics, *OF_THE_MAP):
            table.add_column(f'{metric.removesuffix("_ms")}\n{unit(metric)}', justify='right', no_wrap=True)
        for scene in document['scenes']:
            figures = {name: method['scenes'][scene] for name, method in methods.items()}
            _add_rows(table, scene, figures, region, metrics)
        table.add_section()
        _add_rows(table, 'weighted', {name: method['weighted'] for name, method in methods.items()}, region, metrics)
        console.print(table)


def _add_rows(
    table: Table, label: str, figures: Mapping[str, Mapping[str, float]], region: str, metrics: Sequence[str]
) -> None:
    for number, (method, values) in enumerate(figures.items()):
        cells = [written(metric, values[f'{metric}_{region}']) for metric in metrics]
        whole = [written(metric, values[metric]) for metric in OF_THE_MAP]
        table.add_row('' if number else escape(cut(label)), escape(cut(method)), *cells, *whole)
