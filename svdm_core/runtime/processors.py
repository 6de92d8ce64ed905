"""The processors this process may use, and how long its threads have waited for one."""
from __future__ import annotations

import contextlib
import os
from pathlib import Path

_THREADS = Path('/proc/self/task')


def processor_count() -> int:
    """Processors this process may run on."""
    return len(os.sched_getaffinity(0))


def waited_seconds() -> float | None:
    """How long the threads of this process were ready to run and had to wait, since they began; None if not counted.

    That is the work of others on these processors: the load of the machine would count this process as well.
    """
    waited = 0
    for thread in _THREADS.iterdir():
        with contextlib.suppress(FileNotFoundError, ProcessLookupError):  # a thread that has ended meanwhile
            if not (figures := _schedstat(thread)):
                return None
            waited += int(figures[1])
    return waited / 1e9


def _schedstat(thread: Path) -> list[str]:
    """Nanoseconds run, nanoseconds waited, turns; empty where the kernel does not keep them."""
    try:
        return (thread / 'schedstat').read_text().split()
    except FileNotFoundError:
        if thread.exists():
            return []
        raise
