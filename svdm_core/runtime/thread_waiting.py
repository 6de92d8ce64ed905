"""How long threads wait busily for the next parallel loop.

GNU's OpenMP, which numba runs on, lets them spin for milliseconds by default. Where another process needs a core, the
spinning thread holds it against the one it waits for: one such process made a frame take five times as long, and with
short spinning twice.
"""
from __future__ import annotations

import os

# Enough for the pause between two loops of a frame.
_SPINS = '10000'


def wait_briefly() -> None:
    """Set it for this process, unless the environment says something else. Before the first parallel loop only."""
    if 'OMP_WAIT_POLICY' not in os.environ:
        os.environ.setdefault('GOMP_SPINCOUNT', _SPINS)
