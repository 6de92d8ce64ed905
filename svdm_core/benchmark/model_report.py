"""Shows the work-span model: a table for each contender, and a plot of all."""
from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

from rich.table import Table

from .report import output_console

_COLOURS = ('tab:red', 'tab:blue', 'tab:green', 'tab:orange', 'tab:purple', 'tab:brown')


def print_model(document: Mapping[str, Any]) -> None:
    """A table for each contender, or the line that says why there is none."""
    console = output_console()
    for name, value in document['model'].items():
        if 'not_modelled' in value:
            console.print(f'{name} is not modelled: {value["not_modelled"]}', soft_wrap=True)
            continue
        table = Table(title=f'{name}: model of {title(document)}')
        for heading in ('threads', 'ms', 'speed-up', 'measured ms', 'difference'):
            table.add_column(heading, justify='right', no_wrap=True)
        for row in value['rows']:
            table.add_row(*_cells(row))
        console.print(table)
        console.print(f'{name}: {_parts(value)}', soft_wrap=True)


def title(document: Mapping[str, Any]) -> str:
    """What was timed."""
    width, height = document['size']
    return f'{width}x{height} {"colour" if document["colour"] else "grey"}, {document["disparities"]} disparities'


def draw_model(document: Mapping[str, Any], suffix: str) -> bytes:
    """A picture of the speed-up over the threads, with what was measured and the ideal."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8, 6), layout='constrained')
    ax = figure.add_subplot()
    modelled = {name: value['rows'] for name, value in document['model'].items() if 'rows' in value}
    for number, (name, rows) in enumerate(modelled.items()):
        colour = _COLOURS[number % len(_COLOURS)]
        ax.plot([row['threads'] for row in rows], [row['speed_up'] for row in rows], 'o-', color=colour, label=name)
        measured = [row for row in rows if row['measured_ms'] is not None]
        ax.plot([row['threads'] for row in measured],
                [row['speed_up'] * row['ms'] / row['measured_ms'] for row in measured], 'x', color=colour,
                markersize=10, markeredgewidth=2, label=f'{name}, measured')
    counts = [row['threads'] for row in next(iter(modelled.values()))]
    ax.plot(counts, counts, '--', color='grey', label='ideal')
    ax.set_xscale('log', base=2)
    ax.set_yscale('log', base=2)
    for axis in (ax.xaxis, ax.yaxis):
        axis.set_major_formatter('{x:g}')
    ax.set_xticks(counts, [str(count) for count in counts])
    ax.set(xlabel='threads', ylabel='speed-up over one thread', title=f'work-span model, {title(document)}')
    ax.grid(alpha=0.3)
    ax.legend()
    picture = io.BytesIO()
    figure.savefig(picture, dpi=120, format=suffix.lower().removeprefix('.'))
    return picture.getvalue()


def _cells(row: Mapping[str, Any]) -> list[str]:
    measured, difference = row['measured_ms'], row['difference_percent']
    return [str(row['threads']), f'{row["ms"]:.1f}', f'{row["speed_up"]:.2f}',
            '' if measured is None else f'{measured:.1f}', '' if difference is None else f'{difference:+.0f} %']


def _parts(value: Mapping[str, Any]) -> str:
    phases = value['phases']
    tasks = sum(sum(phase['tasks_ms']) for phase in phases)
    entries, shared = (sum(phase[key] for phase in phases) for key in ('entry_ms', 'shared_entry_ms'))
    count = sum(len(phase['tasks_ms']) for phase in phases)
    return (f'{count} tasks {tasks:.1f} ms, entering {len(phases)} phases {entries:.2f} ms with one thread and '
            f'{shared:.2f} ms with several, serial {value["serial_ms"]:.1f} ms')
