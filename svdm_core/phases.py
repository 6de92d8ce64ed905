"""Who does the work: phases of independent tasks, which the threads of a crew draw from one heap."""
from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from typing import Any, NamedTuple

import numba
import numpy as np

from .kernels.arrays import Uint8, aligned_zeros
from .kernels.compilation import THREADS
from .kernels.tasks import whole_lines


class Phase(NamedTuple):
    """Tasks 0 .. tasks - 1 in any order, all done before the next phase begins.

    stage: whose time it is. run(counter, end, arenas, *arguments), a kernel, has the threads share the tasks from
    counter[0] to end - 1 (`tasks.share`), each thread with its row of arenas as scratch of `scratch` bytes.
    """

    stage: str
    tasks: int
    run: Callable[..., None]
    arguments: tuple[Any, ...]
    scratch: int = 0


class Crew:
    """The threads of a matcher and their scratch, kept from frame to frame."""

    def __init__(self) -> None:
        self._arenas: Uint8 = aligned_zeros((1, 0), np.uint8)
        self._counter = np.zeros(1, np.int64)

    def gather(self, threads: int) -> None:
        """From now on up to `threads` threads; 0: one for each core."""
        count = min(threads or THREADS, THREADS)
        if self._arenas.shape[0] != count:
            self._resize(count, self._arenas.shape[1])
        numba.set_num_threads(count)

    def _resize(self, threads: int, size: int) -> None:
        self._arenas = aligned_zeros((1, 0), np.uint8)  # free the old ones before the new ones are made
        self._arenas = aligned_zeros((threads, size), np.uint8)

    @property
    def threads(self) -> int:
        return int(self._arenas.shape[0])

    def work(self, phase: Phase, first: int = 0, end: int | None = None) -> None:
        """Do a phase, or its tasks first .. end - 1."""
        size = whole_lines(phase.scratch)
        if self._arenas.shape[1] < size:
            self._resize(self.threads, size)
        self._counter[0] = first
        phase.run(self._counter, phase.tasks if end is None else end, self._arenas, *phase.arguments)


class StageClock:
    """Adds up the seconds spent in each stage, on top of those of earlier stages."""

    def __init__(self, earlier: Mapping[str, float] | None = None) -> None:
        self.seconds = dict(earlier or {})

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def work(self, crew: Crew, phases: Iterable[Phase]) -> None:
        """Do the phases one after the other."""
        for phase in phases:
            start = time.perf_counter()
            crew.work(phase)
            self.seconds[phase.stage] = self.seconds.get(phase.stage, 0.0) + time.perf_counter() - start

    def milliseconds(self) -> dict[str, float]:
        """Stage -> milliseconds, and their sum 'total'."""
        stages = {name: 1e3 * seconds for name, seconds in self.seconds.items()}
        return {**stages, 'total': sum(stages.values())}
