"""How much memory this process can still have."""
from __future__ import annotations

import resource
from pathlib import Path


def free_memory() -> int | None:
    """Bytes without swapping: what the machine has, this process's control group and `ulimit -v` allow; None where
    nothing is known."""
    known = [free for free in (_of_machine(), _of_group(), _of_limit()) if free is not None]
    return min(known, default=None)


def _of_machine() -> int | None:
    for line in _lines(Path('/proc/meminfo')):
        if line.startswith('MemAvailable:'):
            return int(line.split()[1]) * 1024
    return None


def _of_group() -> int | None:
    """Of the group and all above it (cgroup v2), or of the group that a container sees as its own (v1)."""
    places = [('/sys/fs/cgroup/memory', 'memory.limit_in_bytes', 'memory.usage_in_bytes')]
    for line in _lines(Path('/proc/self/cgroup')):
        if line.startswith('0::'):
            group = Path('/sys/fs/cgroup') / line[3:].lstrip('/')
            places += [(str(folder), 'memory.max', 'memory.current') for folder in (group, *group.parents)
                       if folder.is_relative_to('/sys/fs/cgroup')]
    free = [limit - used for folder, *names in places
            for limit, used in [[_number(Path(folder) / name) for name in names]]
            if limit is not None and used is not None]
    return max(0, min(free)) if free else None


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
