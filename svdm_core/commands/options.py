"""What several commands share of their command lines."""
from __future__ import annotations

import argparse


def count(text: str) -> int:
    """An integer from 1 up."""
    if not text.isdecimal() or int(text) < 1:
        raise argparse.ArgumentTypeError(f'{text!r} is not allowed: it must be an integer from 1 up')
    return int(text)
