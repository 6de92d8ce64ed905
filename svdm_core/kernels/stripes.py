"""The unit of work: stripes of rows, always the same ones, however many threads there are."""
from __future__ import annotations

from typing import NamedTuple

from .compilation import kernel

STRIPE = 60
"""Image rows of a stripe: enough tasks for 16 threads of a small image, few enough for the overlap not to count."""

OVERLAP = 24
"""Image rows that a vertical path begins before its stripe: then it has forgotten where it began."""

BLOCK = 16
"""Image rows of a task of the stages that need no overlap."""


class Rows(NamedTuple):
    """The rows of a view that are matched: row y of `height` is image row `offset + every * y`."""

    height: int
    width: int
    every: int
    offset: int


def rows_of(shape: tuple[int, ...], every: int) -> Rows:
    """Every `every`-th row of images of `shape`, from the middle of the first few on; all, where there are too few."""
    height, width = shape[:2]
    offset = every // 2
    return Rows(-(-(height - offset) // every), width, every, offset) if height > offset else Rows(height, width, 1, 0)


def stripe_count(rows: Rows) -> int:
    """Stripes of a view."""
    return -(-rows.height // (STRIPE // rows.every))


@kernel
def stripe_rows(rows: Rows, stripe: int) -> tuple[int, int]:
    """First row and end of a stripe, rows of the view."""
    size = STRIPE // rows.every
    return stripe * size, min(rows.height, (stripe + 1) * size)


def block_count(rows: int) -> int:
    """Tasks of a stage without overlap."""
    return -(-rows // BLOCK)
