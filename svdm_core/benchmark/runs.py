"""How fast the presets are beside OpenCV's matchers: same images, one process, contenders in turn."""
from __future__ import annotations

import dataclasses
import multiprocessing
import multiprocessing.pool
import signal
import statistics
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from ..evaluation.metrics import error_metrics
from ..evaluation.opencv_matchers import OpenCVMatcher
from ..kernels.arrays import Float32, Image
from ..matcher import StereoMatcher
from ..runtime import configure
from ..runtime.processors import processor_count, waited_seconds
from .contenders import is_own, parameters_of, threads_used, work_of
from .limits import check_limits, smallest_width

ACCURACY = ('avgerr', 'bad1', 'bad2', 'bad4')
_BUSY = 5.0
"""Percent of its time that a contender waits for a processor, from which the ratios are no longer to be trusted."""


@dataclasses.dataclass(frozen=True, slots=True)
class BenchmarkPair:
    """left, right: uint8 (H, W) or (H, W, 3). ground_truth: float32 (H, W), px, not finite where unknown, or None."""

    left: Image
    right: Image
    ground_truth: Float32 | None = None

    def scaled(self, width: int, height: int) -> BenchmarkPair:
        """The pair at another size; disparities shrink with the width."""
        factor = width / self.left.shape[1]
        way = cv2.INTER_AREA if factor < 1 else cv2.INTER_LINEAR
        left, right = (np.asarray(cv2.resize(image, (width, height), interpolation=way))
                       for image in (self.left, self.right))
        truth = self.ground_truth
        if truth is not None:
            truth = np.asarray(cv2.resize(truth, (width, height), interpolation=cv2.INTER_NEAREST)) * np.float32(factor)
        return BenchmarkPair(left, right, truth)

    def tiled(self, width: int, height: int) -> BenchmarkPair:
        """The pair cut off or repeated to another size: each pixel gives as much work as before."""
        def fit(image: Any) -> Any:
            rows, columns = -(-height // image.shape[0]), -(-width // image.shape[1])
            repeated = np.tile(image, (rows, columns) + (1,) * (image.ndim - 2))
            return np.ascontiguousarray(repeated[:height, :width])

        truth = None if self.ground_truth is None else fit(self.ground_truth)
        return BenchmarkPair(fit(self.left), fit(self.right), truth)

    def grey(self) -> BenchmarkPair:
        """The pair without colour."""
        if self.left.ndim == 2:
            return self
        left, right = (np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)) for image in (self.left, self.right))
        return BenchmarkPair(left, right, self.ground_truth)


def run_benchmark(
    pair: BenchmarkPair,
    names: Sequence[str],
    num_disparities: int,
    threads: int,
    rounds: int,
    on_round: Callable[[], None] = lambda: None,
    memory: bool = True,
) -> dict[str, dict[str, Any]]:
    """Time all contenders in turn, `rounds` times after a warm-up; figures by name.

    median_ms, low_ms and high_ms (quartiles), mde_per_s (million disparities evaluated a second: width x height x
    num_disparities over the time), mde_per_s_core (the same by the threads that it can use), work (the paths and
    matched views that a disparity stands for), stages_ms (medians, own matchers), extra_mb (peak memory above that of
    a tiny image, in a process of its own), and where there is ground truth avgerr, bad1, bad2, bad4 of the dense map
    (px of these images, %), over all known pixels.
    waited_percent: of their time that its threads waited for a processor, None where the system does not tell.

    Raises ValueError for images too small for OpenCV, or too large for the memory.
    """
    check_limits(pair.left.shape[1], pair.left.shape[0], num_disparities)
    contenders = {name: _Contender(name, pair, num_disparities, threads) for name in names}
    for contender in contenders.values():
        contender.run()
    for _ in range(rounds):
        for contender in contenders.values():
            contender.run_timed()
        on_round()
    work = pair.left.shape[0] * pair.left.shape[1] * num_disparities / 1e6
    figures = {}
    for name, contender in contenders.items():
        low, median, high = _quartiles(contender.milliseconds)
        figures[name] = {
            'median_ms': median, 'low_ms': low, 'high_ms': high, 'mde_per_s': 1e3 * work / median,
            'mde_per_s_core': 1e3 * work / median / threads_used(name, threads), 'work': work_of(name),
            'stages_ms': contender.stages(rounds), **contender.accuracy(),
            'waited_percent': contender.waited_percent(threads),
            'extra_mb': extra_memory(name, pair, num_disparities, threads) if memory else None,
        }
    return figures


def extra_memory(name: str, pair: BenchmarkPair, num_disparities: int, threads: int) -> float:
    """Peak memory (MB) that one frame takes on top of a matcher warmed up with a tiny image."""
    with _one_process() as pool:
        return pool.apply(_extra_memory, (name, pair, num_disparities, threads))


def _one_process() -> multiprocessing.pool.Pool:
    """A new process that is deaf to Ctrl-C, which it would answer with a traceback: this one ends it."""
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})  # a process inherits it
    try:
        return multiprocessing.get_context('spawn').Pool(1)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def usable_threads(wanted: int) -> int:
    """`wanted`, but not more than there are processors."""
    return min(wanted, processor_count())


def busy_line(figures: Mapping[str, Mapping[str, Any]]) -> str:
    """One line where contenders had to wait for others' work on the processors; empty where the machine was idle."""
    waited = {name: value['waited_percent'] for name, value in figures.items() if value['waited_percent'] is not None}
    worst = max(waited, key=lambda name: waited[name], default='')
    if not worst or waited[worst] < _BUSY:
        return ''
    return (f'the machine was busy: {worst} waited for a processor {waited[worst]:.0f} % of its time. Times and ratios '
            'shift then: run it again when nothing else does')


def growth(sizes: Sequence[float], milliseconds: Sequence[float]) -> float:
    """The exponent of time over size: the slope of the straight line through the logarithms."""
    return float(np.polyfit(np.log(sizes), np.log(milliseconds), 1)[0])


def ratios(figures: Mapping[str, Mapping[str, Any]]) -> dict[str, dict[str, float]]:
    """Median time of each contender over that of each of OpenCV's methods."""
    yardsticks = {name: value['median_ms'] for name, value in figures.items() if not is_own(name)}
    return {name: {other: value['median_ms'] / ms for other, ms in yardsticks.items()}
            for name, value in figures.items()}


class _Contender:
    """One matcher with its images; keeps what it said of its stages."""

    def __init__(self, name: str, pair: BenchmarkPair, num_disparities: int, threads: int) -> None:
        cv2.setNumThreads(threads)
        self._pair = pair
        self._own: StereoMatcher | None = None
        self._timings: list[dict[str, float]] = []
        self.milliseconds: list[float] = []
        self._waited: list[float | None] = []
        if is_own(name):
            self._own = StereoMatcher(parameters_of(name).replace(num_disparities=num_disparities), threads)
        else:
            channels = 1 if pair.left.ndim == 2 else pair.left.shape[2]
            self._opencv = OpenCVMatcher(name, num_disparities, channels)

    def run(self) -> None:
        if self._own is None:
            self._opencv.compute(self._pair.left, self._pair.right)
        else:
            self._timings.append(self._own.compute(self._pair.left, self._pair.right).timings)

    def run_timed(self) -> None:
        before, start = waited_seconds(), time.perf_counter()
        self.run()
        self.milliseconds.append(1e3 * (time.perf_counter() - start))
        after = waited_seconds()
        self._waited.append(None if before is None or after is None else max(0.0, after - before))

    def waited_percent(self, threads: int) -> float | None:
        """Percent of the timed runs that each of its threads spent waiting for a processor, on average."""
        waited = [seconds for seconds in self._waited if seconds is not None]
        return 1e5 * sum(waited) / (sum(self.milliseconds) * threads) if waited else None

    def stages(self, last: int) -> dict[str, float]:
        """Median milliseconds of each stage over the last frames."""
        frames = self._timings[-last:]
        return {stage: statistics.median(frame[stage] for frame in frames) for stage in (frames[0] if frames else ())}

    def accuracy(self) -> dict[str, float]:
        pair = self._pair
        if pair.ground_truth is None:
            return {}
        if self._own is None:
            disparity = self._opencv.compute_dense(pair.left, pair.right)
        else:
            disparity = self._own.compute(pair.left, pair.right).disparity
        metrics = error_metrics(disparity, pair.ground_truth)
        return {name: metrics[name] for name in ACCURACY}


def _extra_memory(name: str, pair: BenchmarkPair, num_disparities: int, threads: int) -> float:
    configure()  # as the command that measures the times
    width = max(200, smallest_width(num_disparities))
    tiny = BenchmarkPair(*(np.ascontiguousarray(image[:40, :width]) for image in (pair.left, pair.right)))
    _Contender(name, tiny, num_disparities, threads).run()
    before = _peak_memory()
    _Contender(name, pair, num_disparities, threads).run()
    return _peak_memory() - before


def _peak_memory() -> float:
    """Largest resident size of this process so far, MB. (getrusage would count the parent's before the exec.)"""
    status = Path('/proc/self/status').read_text()
    return float(status.split('VmHWM:')[1].split()[0]) / 1024


def _quartiles(values: Sequence[float]) -> tuple[float, float, float]:
    low, median, high = np.percentile(values, (25, 50, 75))
    return float(low), float(median), float(high)
