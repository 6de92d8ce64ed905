"""What is printed of a run: a table by minute, what a steady run has kept to, the faults, and a verdict."""
from __future__ import annotations

import sys

from rich.console import Console
from rich.table import Table

from .run import Settings
from .steadiness import steadiness
from .tally import COLUMNS, Tally, rows, verdict

_FAULTS_SHOWN = 5
"""Of each kind."""
_WIDTH = 110


def report(tally: Tally, settings: Settings) -> bool:
    """Print it, the faults on stderr; whether all is well."""
    width, height = settings.size
    table = Table(*COLUMNS, title=f'{width}x{height} px, {settings.rate:g} pairs a second, seed {settings.seed}')
    for row in rows(tally):
        table.add_row(*row)
    Console(width=_WIDTH).print(table)
    broken: list[str] = []
    if settings.steady:
        found = steadiness(tally)
        broken = found.faults
        print(*found.lines(), sep='\n')
    for kind, texts in tally.faults.items():
        print(f'soak: {kind}, {len(texts)} times:', *texts[:_FAULTS_SHOWN], sep='\n    ', file=sys.stderr)
    for limit in broken:
        print(f'soak: {limit}', file=sys.stderr)
    print(verdict(tally))
    return tally.is_well and not broken
