"""A camera, the node and a listener as processes of their own, and what the listener saw: see `svdm_ros.benchmark`."""
from __future__ import annotations

import dataclasses
import itertools
import os
import statistics
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from stereo_msgs.msg import DisparityImage

from svdm_core.presets import preset_folder

from ..processes.camera import SENT
from ..processes.children import Child, RunError, isolated_environment
from ..processes.dds_profile import write_profile
from ..processes.session import Session
from .first_output import first_outputs

START_TIMEOUT, COMPILE_TIMEOUT = 30.0, 240.0  # s
WARM_UP = 3.0  # s left out at the beginning
_STAGE = 'total (ms)'


@dataclasses.dataclass(frozen=True, slots=True)
class MatcherReport:
    """One diagnostics message: when it came (ns), how many disparity images the node had published by then, and how
    long its matcher took for those since the message before, on average (ms)."""

    received: int
    published: int
    mean_ms: float


class Listener(Session):
    """Notes when each disparity image was stamped and received (ns), and what the node says its matcher takes."""

    def __init__(self, check: Callable[[], None]) -> None:
        super().__init__(check)
        self.times: list[tuple[int, int]] = []
        self.matcher: list[MatcherReport] = []

    def _take_disparity(self, message: DisparityImage) -> None:
        stamp = message.header.stamp
        self.times.append((stamp.sec * 10**9 + stamp.nanosec, time.time_ns()))

    def _take_counts(self, message: DiagnosticArray) -> None:
        super()._take_counts(message)
        if _STAGE in self.counts:
            self.matcher.append(MatcherReport(time.time_ns(), self.count('published'), float(self.counts[_STAGE])))


def measure(
    size: tuple[int, int], rate: float, seconds: float, preset: str, check: Callable[[], None]
) -> dict[str, Any]:
    """Run the three processes; the figures by name. Raises RunError, and whatever `check`, called often, raises."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ.update(isolated_environment(
            folder / 'ros_log', write_profile(preset_folder() / 'fastdds.xml', folder / 'fastdds.xml')))
        children: list[Child] = []

        def start(name: str, module: str, *arguments: str) -> Child:
            children.append(Child(name, folder / f'{name}.log', module, *arguments, log_stays=False))
            return children[-1]

        def check_all() -> None:
            check()
            for child in children:
                child.check()

        try:
            start('node', 'svdm_ros', '--ros-args', '--params-file', str(preset_folder() / f'{preset}.yaml'))
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            listener = Listener(check_all)
            listener.wait_for_node(START_TIMEOUT)
            listener.wait_until_ready(COMPILE_TIMEOUT, 'the kernels were not ready')
            camera = start('camera', 'svdm_ros.processes.camera', '--rate', str(rate), '--size', *map(str, size))
            listener.listen(START_TIMEOUT)
            listener.wait_for(lambda: bool(listener.times), START_TIMEOUT, 'no disparity image arrived')
            end = time.monotonic() + WARM_UP + seconds
            listener.wait_for(lambda: time.monotonic() > end, 2 * (WARM_UP + seconds), 'the clock stood still')
            sent = [int(line.split()[1]) for line in camera.output().splitlines() if line.startswith(SENT)]
            found = figures(sent, listener.times, listener.matcher, seconds, listener.counts)
            listener.close()
            return {**found, 'first_output_s': first_outputs(check_all)}
        finally:
            for child in reversed(children):
                child.stop()
            try_shutdown()


def figures(
    sent: Sequence[int], times: Sequence[tuple[int, int]], reports: Sequence[MatcherReport], seconds: float,
    counts: dict[str, str],
) -> dict[str, Any]:
    """Of what was sent (stamps, ns), received (stamp and receipt, ns) and told within the `seconds` that count.

    Raises RunError where nothing was received in them.
    """
    start = times[0][1] + int(WARM_UP * 1e9)
    stop = start + int(seconds * 1e9)
    latencies = [(received - stamp) / 1e6 for stamp, received in times if start <= received < stop]
    if not latencies:
        raise RunError(f'no disparity image arrived in the {seconds:g} s that count')
    return {
        'in_hz': sum(start <= stamp < stop for stamp in sent) / seconds,
        'out_hz': len(latencies) / seconds,
        'latency_ms': {'mean': statistics.fmean(latencies),
                       **{f'p{p}': float(np.percentile(latencies, p)) for p in (50, 90, 99)}},
        'matcher_ms': matcher_mean(reports, start, stop),
        'node_latency_ms': float(counts['latency p50 (ms)']) if 'latency p50 (ms)' in counts else None,
        'diagnostics': counts,
    }


def matcher_mean(reports: Sequence[MatcherReport], start: int, stop: int) -> float | None:
    """ms of the matcher, the mean over all frames of the reports whose whole time lies between `start` and `stop`.

    None where there is no such report: they come once a second.
    """
    inside = [(report.published - before.published, report.mean_ms)
              for before, report in itertools.pairwise(reports)
              if start <= before.received and report.received <= stop]
    frames = sum(count for count, _ in inside)
    return sum(count * milliseconds for count, milliseconds in inside) / frames if frames else None
