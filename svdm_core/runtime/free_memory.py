"""How much memory this process can still have."""
from __future__ import annotations

import math
import resource
import time
from pathlib import Path

_GROUPS = Path('/sys/fs/cgroup')
_RECENT = 1.0
"""Seconds."""


def free_memory() -> int | None:
    """Bytes without swapping: what the machine has, this process's control group and `ulimit -v` allow; None where
    nothing is known."""
    known = [free for free in (_of_machine(), _of_group(), _of_limit()) if free is not None]
    return min(known, default=None)


class RecentFreeMemory:
    """`free_memory`, up to a second old, where it is asked for many times a second: reading it takes about 1 ms."""

    def __init__(self) -> None:
        self._read_at = -math.inf
        self._free: int | None = None

    def __call__(self) -> int | None:
        now = time.monotonic()
        if now - self._read_at > _RECENT:
            self._read_at, self._free = now, free_memory()
        return self._free


def _of_machine() -> int | None:
    for line in _lines(Path('/proc/meminfo')):
        if line.startswith('MemAvailable:'):
            return int(line.split()[1]) * 1024
    return None


def _of_group() -> int | None:
    """Of the group and all above it (cgroup v2), or of the group that a container sees as its own (v1)."""
    groups = [(_GROUPS / 'memory', 'memory.limit_in_bytes', 'memory.usage_in_bytes', 'total_inactive_file')]
    for line in _lines(Path('/proc/self/cgroup')):
        if line.startswith('0::'):
            group = _GROUPS / line[3:].lstrip('/')
            groups += [(folder, 'memory.max', 'memory.current', 'inactive_file') for folder in (group, *group.parents)
                       if folder.is_relative_to(_GROUPS)]
    free = [_free_in(*group) for group in groups]
    return min((one for one in free if one is not None), default=None)


def _free_in(folder: Path, limit_file: str, usage_file: str, cached_key: str) -> int | None:
    """Of one group. Its usage holds the files it has read and written, which give way."""
    limit, used = (_number(folder / name) for name in (limit_file, usage_file))
    if limit is None or used is None:
        return None
    cached = dict(line.split()[:2] for line in _lines(folder / 'memory.stat') if len(line.split()) == 2)
    return max(0, limit - used + int(cached.get(cached_key, 0)))


def _of_limit() -> int | None:
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    lines = _lines(Path('/proc/self/statm'))
    if limit == resource.RLIM_INFINITY or not lines:
        return None
    return max(0, limit - int(lines[0].split()[0]) * resource.getpagesize())


def _number(file: Path) -> int | None:
    """What a file of a control group says; None for 'max', and where there is none."""
    lines = _lines(file)
    return int(lines[0]) if lines and lines[0].isdigit() else None


def _lines(file: Path) -> list[str]:
    try:
        return file.read_text().splitlines()
    except OSError:
        return []
