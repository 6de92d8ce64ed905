"""What the demo shows while it works: a live progress display on a terminal, plain lines elsewhere."""
from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from rich.console import Console
from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn
from rich.table import Table

ROWS = (('avgerr', 'mean error', 'px'), ('bad1', 'off by more than 1 px', '%'), ('bad2', 'off by more than 2 px', '%'),
        ('bad4', 'off by more than 4 px', '%'), ('density', 'pixels with a disparity', '%'))


class Display:
    """Shows stages one after the other."""

    def __init__(self) -> None:
        self._console = Console(highlight=False)
        self._progress = Progress(
            SpinnerColumn(finished_text='[green]✓'), TextColumn('{task.description}'), BarColumn(16),
            TimeElapsedColumn(),
            console=self._console, disable=not self._console.is_terminal,
        )

    def __enter__(self) -> Display:
        self._progress.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._progress.stop()

    @contextmanager
    def stage(self, text: str, total: int | None = None) -> Iterator[Callable[[int], None]]:
        """A stage of the work; yields what takes the number of steps done, of `total` (None: it is not known)."""
        if self._progress.disable:
            self._console.print(text, soft_wrap=True)
            yield lambda _: None
            return
        task = self._progress.add_task(text, total=total)
        yield lambda done: self._progress.update(task, completed=done)
        self._progress.update(task, total=total or 1, completed=total or 1)

    def result(self, summary: Mapping[str, Any]) -> None:
        """The table of the three phases and the line on the traffic."""
        phases = summary['before'], summary['after'], summary['default']
        table = Table(title="disparity_node before and after the paper's change of parameters, and with preset default",
                      title_justify='left')
        for heading in ('over all known ground truth', 'before', 'after', 'default'):
            table.add_column(heading, justify='left' if heading.startswith('over') else 'right')
        for key, meaning, unit in ROWS:
            table.add_row(meaning, *(f'{phase[key]:.2f} {unit}' for phase in phases))
        table.add_row('from sending to receipt, median', *(f'{phase["latency_ms"]["p50"]:.0f} ms' for phase in phases))
        table.add_row('disparity images a second', *(f'{phase["fps"]:.1f}' for phase in phases))
        self._console.print(table)
        self.line(f'{summary["frames_sent"]} pairs sent, {summary["frames_received"]} disparity images received, '
                  f'{summary["frames_superseded"]} pairs left out for a newer one, {summary["frames_lost"]} lost')

    def line(self, text: str) -> None:
        """A line of its own."""
        self._console.print(text, soft_wrap=True)
