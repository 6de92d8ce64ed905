"""Types of arguments on a command line, refused with what is allowed. Imports nothing that takes time."""
from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Callable
from pathlib import Path

from ..shown import cut

MOST_THREADS = 1024  # to think of; no machine need have them


def count(text: str) -> int:
    """An integer from 1 up."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'{text!r} is not allowed: it must be an integer from 1 up')
    return int(text)


def thread_counts(text: str) -> list[int]:
    """Different integers from 1 to 1024 in rising order, from '1,2,4'."""
    wanted = {part.strip() for part in text.split(',')}
    for part in wanted:
        if not (part.isdecimal() and len(part) <= 4 and 1 <= int(part) <= MOST_THREADS):
            raise argparse.ArgumentTypeError(f'{part!r} is not allowed: it must be integers from 1 to {MOST_THREADS}, '
                                             'separated by commas')
    return sorted(map(int, wanted))


def size(text: str) -> tuple[int, int]:
    """Width and height of an image, px, from '640x480'."""
    width, _, height = text.partition('x')
    try:
        return count(width), count(height)
    except argparse.ArgumentTypeError:
        raise argparse.ArgumentTypeError(f'{text!r} is not a size: write it as 640x480') from None


FROM_THE_PAIRS = Path()
"""What --align-rows is without a file."""


def alignment_file(text: str) -> Path:
    """The file of --align-rows; a name that is not taken for an image's or a recording's."""
    if Path(text).suffix not in ('.yaml', '.yml'):
        raise argparse.ArgumentTypeError(f'{cut(text)} is not allowed: it must be a .yaml file; without one, write '
                                         '--align-rows last')
    return Path(text)


def positive(text: str) -> float:
    """A finite number above 0."""
    return _number(text, lambda value: value > 0, 'a number above 0')


def not_negative(text: str) -> float:
    """A finite number from 0 up."""
    return _number(text, lambda value: value >= 0, 'a number from 0 up')


def _number(text: str, is_allowed: Callable[[float], bool], allowed: str) -> float:
    with contextlib.suppress(ValueError):
        value = float(text)
        if math.isfinite(value) and is_allowed(value):
            return value
    raise argparse.ArgumentTypeError(f'{text!r} is not allowed: it must be {allowed}')
