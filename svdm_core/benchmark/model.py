"""The work-span model: how long a frame takes on more threads than this machine has.

Every task of every phase is timed alone on one thread. N workers draw them in order, as the threads of a crew do, and
wait for each other at the end of each phase:

    ms(N) = serial + sum over phases (entry + makespan(tasks, N))

The entry of a phase is the time of an empty one. Serial is what a whole frame on one thread takes outside its phases.
Tasks timed alone share out the time that their phase takes in such a frame, as the low quantiles of hundreds of short
tasks sum up to less. What runs on one thread is timed in its processor time, so that waiting for others' work is no
part of it; on an idle machine that is the wall time. The model knows nothing of what threads share: memory, caches,
clock frequency, two threads of one core.
"""
from __future__ import annotations

import heapq
import time
from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

import numpy as np

from ..matcher import StereoMatcher
from ..parameters import MatcherParameters
from ..phases import Crew, Phase, StageClock
from ..runtime.processors import processor_count, waited_seconds
from .runs import BenchmarkPair

QUANTILE = 10.0
"""Percent: which of the times of several rounds counts. Others' work only ever adds to them."""

_ENTRIES = 3  # of each phase in a round: the shortest counts


def makespan(tasks: Iterable[float], workers: int) -> float:
    """When the last task ends where each is taken, in order, by the worker that is free first."""
    free = [0.0] * workers
    for task in tasks:
        heapq.heapreplace(free, free[0] + task)
    return max(free)


class PhaseTimes(NamedTuple):
    """stage: whose phase. entry, shared_entry: ms to enter it with one thread, and with several. tasks: ms each."""

    stage: str
    entry: float
    shared_entry: float
    tasks: tuple[float, ...]


class WorkSpan(NamedTuple):
    """A frame: its phases one after the other, and what runs between them on one thread, ms."""

    phases: tuple[PhaseTimes, ...]
    serial: float

    def frame(self, threads: int) -> float:
        """ms of a frame on so many threads."""
        entries = sum(phase.entry if threads == 1 else phase.shared_entry for phase in self.phases)
        return self.serial + entries + sum(makespan(phase.tasks, threads) for phase in self.phases)


class PhaseClock(StageClock):
    """Keeps the seconds of each phase, of the processor time of this thread."""

    def __init__(self) -> None:
        super().__init__()
        self.phases: list[float] = []

    def work(self, crew: Crew, phases: Iterable[Phase]) -> None:
        for phase in phases:
            with self.stage(phase.stage):
                self.phases.append(_seconds(time.thread_time, crew, phase, 0, phase.tasks))


class TaskClock(StageClock):
    """Does each phase empty first, then on one thread task by task, and keeps the seconds of each."""

    def __init__(self) -> None:
        super().__init__()
        self.stages: list[str] = []
        self.entries: list[float] = []
        self.tasks: list[list[float]] = []

    def work(self, crew: Crew, phases: Iterable[Phase]) -> None:
        for phase in phases:
            with self.stage(phase.stage):
                self.stages.append(phase.stage)
                clock = time.thread_time if crew.threads == 1 else time.perf_counter
                self.entries.append(min(_seconds(clock, crew, phase, 0, 0) for _ in range(_ENTRIES)))
                if crew.threads == 1:
                    self.tasks.append([_seconds(clock, crew, phase, task, task + 1) for task in range(phase.tasks)])
                else:
                    crew.work(phase)


def measure_model(
    pair: BenchmarkPair, parameters: MatcherParameters, threads: Sequence[int], rounds: int,
    on_round: Callable[[], None] = lambda: None,
) -> dict[str, Any]:
    """The model of one set of parameters, and the measured times of those `threads` that this machine has.

    phases: stage, entry_ms, shared_entry_ms, tasks_ms of each. serial_ms. rows: threads, ms, speed_up, and measured_ms
    and difference_percent of the model from it (wall time), None where there are fewer processors. waited_percent: as
    in the benchmark, over the measured frames on one thread.
    """
    most = processor_count()
    frames = _Frames(pair, parameters, {1, *(count for count in threads if count <= most)}, most)
    for _ in range(rounds):
        frames.run()
        on_round()
    span = frames.work_span()
    measured = frames.milliseconds()
    rows = []
    for count in threads:
        ms, wall = span.frame(count), measured.get(count)
        rows.append({'threads': count, 'ms': ms, 'speed_up': span.frame(1) / ms, 'measured_ms': wall,
                     'difference_percent': None if wall is None else 100 * (ms / wall - 1)})
    phases = [{'stage': phase.stage, 'entry_ms': phase.entry, 'shared_entry_ms': phase.shared_entry,
               'tasks_ms': list(phase.tasks)} for phase in span.phases]
    return {'phases': phases, 'serial_ms': span.serial, 'rows': rows, 'waited_percent': frames.waited_percent()}


class _Frames:
    """The same frame again and again: whole on each number of threads, and task by task; in turn, as loads change."""

    def __init__(self, pair: BenchmarkPair, parameters: MatcherParameters, counts: set[int], most: int) -> None:
        self._pair = pair
        self._by_phase: list[PhaseClock] = []
        self._alone: list[TaskClock] = []
        self._together: list[TaskClock] = []
        self._whole = {count: StereoMatcher(parameters, count) for count in sorted(counts - {1})}
        self._whole[1] = StereoMatcher(parameters, 1, clock=_kept(PhaseClock, self._by_phase))
        self._by_task = [StereoMatcher(parameters, 1, clock=_kept(TaskClock, self._alone)),
                         StereoMatcher(parameters, most, clock=_kept(TaskClock, self._together))]
        self._walls: dict[int, list[float]] = {count: [] for count in self._whole}
        self._serial: list[float] = []
        self._waited: list[float | None] = []
        for matcher in (*self._whole.values(), *self._by_task):
            self._seconds(matcher)  # compiled and allocated before the first round
        for clocks in (self._by_phase, self._alone, self._together):
            clocks.clear()

    def _seconds(self, matcher: StereoMatcher) -> tuple[float, float]:
        """Wall time, and processor time of this thread."""
        start, own = time.perf_counter(), time.thread_time()
        matcher.compute(self._pair.left, self._pair.right)
        return time.perf_counter() - start, time.thread_time() - own

    def run(self) -> None:
        """One round."""
        for count, matcher in self._whole.items():
            before = waited_seconds()
            wall, own = self._seconds(matcher)
            after = waited_seconds()
            self._walls[count].append(wall)
            if count == 1:
                self._serial.append(own - sum(self._by_phase[-1].phases))
                self._waited.append(None if before is None or after is None else max(0.0, after - before))
        for matcher in self._by_task:
            self._seconds(matcher)

    def milliseconds(self) -> dict[int, float]:
        """Wall times of whole frames by their threads."""
        return {count: float(_low(walls)) for count, walls in self._walls.items()}

    def waited_percent(self) -> float | None:
        """Percent of the whole frames on one thread that it waited for a processor."""
        waited = [seconds for seconds in self._waited if seconds is not None]
        return 100 * sum(waited) / sum(self._walls[1]) if waited else None

    def work_span(self) -> WorkSpan:
        """The low quantiles of the rounds."""
        entries = _low([clock.entries for clock in self._alone])
        shared = np.maximum(_low([clock.entries for clock in self._together]), entries)
        whole = _low([clock.phases for clock in self._by_phase])
        phases = [
            PhaseTimes(stage, float(entries[number]), float(shared[number]), shared_out(
                float(whole[number] - entries[number]),
                # A task that is done alone enters the phase.
                (_low([clock.tasks[number] for clock in self._alone]) - entries[number]).tolist()))
            for number, stage in enumerate(self._alone[0].stages)]
        return WorkSpan(tuple(phases), float(_low(self._serial)))


def shared_out(total: float, tasks: Sequence[float]) -> tuple[float, ...]:
    """`tasks` scaled so that they sum to `total`; none is less than nothing."""
    positive = [max(task, 0.0) for task in tasks]
    scale = max(total, 0.0) / (sum(positive) or 1.0)
    return tuple(scale * task for task in positive)


def _kept[Clock: StageClock](kind: Callable[[], Clock], clocks: list[Clock]) -> Callable[[], StageClock]:
    """Makes clocks that stay in the list."""
    def made() -> StageClock:
        clocks.append(kind())
        return clocks[-1]

    return made


def _seconds(clock: Callable[[], float], crew: Crew, phase: Phase, first: int, end: int) -> float:
    start = clock()
    crew.work(phase, first, end)
    return clock() - start


def _low(seconds: Any) -> Any:
    """ms: the low quantile over the rounds, the first axis."""
    return 1e3 * np.percentile(np.asarray(seconds), QUANTILE, axis=0)
