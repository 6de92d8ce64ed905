"""How fast the node is: a camera, the node and a listener as processes of their own on this machine, over DDS.

python -m svdm_ros.node_benchmark [--size 640 480] [--rate 30] [--seconds 15] [--preset fast] [--json FILE]
"""
from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from rclpy.signals import SignalHandlerOptions
from stereo_msgs.msg import DisparityImage

from svdm_core.presets import preset_folder

from .demo.processes import Child, DemoError, isolated_environment, write_profile
from .demo.publisher import SENT
from .demo.session import Session

READY = 'ready: '  # the node's log says so when its kernels are there
START_TIMEOUT, COMPILE_TIMEOUT = 30.0, 240.0  # s
WARM_UP = 3.0  # s left out at the beginning


class Listener(Session):
    """Notes when each disparity image was stamped and received (ns), and what the node says its matcher takes (ms)."""

    def __init__(self, check: Any) -> None:
        super().__init__(check)
        self.times: list[tuple[int, int]] = []
        self.matcher: list[float] = []

    def _take_disparity(self, message: DisparityImage) -> None:
        stamp = message.header.stamp
        self.times.append((stamp.sec * 10**9 + stamp.nanosec, time.time_ns()))

    def _take_counts(self, message: DiagnosticArray) -> None:
        super()._take_counts(message)
        if 'total (ms)' in self.counts:
            self.matcher.append(float(self.counts['total (ms)']))


def measure(size: tuple[int, int], rate: float, seconds: float, preset: str) -> dict[str, Any]:
    """Run the three processes; the figures by name. Raises DemoError."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ.update(isolated_environment(
            folder / 'ros_log', write_profile(preset_folder() / 'fastdds.xml', folder / 'fastdds.xml')))
        node = Child('node', folder / 'node.log', 'svdm_ros', '--ros-args', '--params-file',
                     str(preset_folder() / f'{preset}.yaml'))
        children = [node]
        rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
        try:
            listener = Listener(lambda: [child.check() for child in children] and None)
            listener.wait_for_node(START_TIMEOUT)
            listener.wait_for(lambda: READY in node.output(), COMPILE_TIMEOUT, 'the kernels were not ready')
            camera = Child('camera', folder / 'camera.log', 'svdm_ros.demo.publisher', '--rate', str(rate),
                           '--size', *map(str, size))
            children.append(camera)
            listener.wait_for(lambda: bool(listener.times), START_TIMEOUT, 'no disparity image arrived')
            end = time.monotonic() + WARM_UP + seconds
            listener.wait_for(lambda: time.monotonic() > end, 2 * (WARM_UP + seconds), 'the clock stood still')
            sent = [int(line.split()[1]) for line in camera.output().splitlines() if line.startswith(SENT)]
            return _figures(sent, listener, seconds)
        finally:
            for child in reversed(children):
                child.stop()
            rclpy.try_shutdown()


def _figures(
    sent: Sequence[int], listener: Listener, seconds: float
) -> dict[str, Any]:
    times = listener.times
    start = times[0][1] + int(WARM_UP * 1e9)
    stop = start + int(seconds * 1e9)
    latencies = [(received - stamp) / 1e6 for stamp, received in times if start <= received < stop]
    if not latencies:
        raise DemoError(f'no disparity image arrived in the {seconds:g} s that count')
    return {
        'in_hz': sum(start <= stamp < stop for stamp in sent) / seconds,
        'out_hz': len(latencies) / seconds,
        'latency_ms': {f'p{p}': float(np.percentile(latencies, p)) for p in (50, 90, 99)},
        'matcher_ms': statistics.median(listener.matcher) if listener.matcher else math.nan,
        'node_latency_ms': float(listener.counts.get('latency p50 (ms)', 'nan')),
        'diagnostics': listener.counts,
    }


def main() -> int:
    """Entry of the command: 0, or 1 with one line that says what went wrong."""
    parser = argparse.ArgumentParser(description='Measure the node at a given image size and rate.')
    parser.add_argument('--size', type=int, nargs=2, default=(640, 480), metavar=('W', 'H'), help='px (640 480)')
    parser.add_argument('--rate', type=float, default=30.0, help='pairs sent a second (30)')
    parser.add_argument('--seconds', type=float, default=15.0, help='how long to count (15)')
    parser.add_argument('--preset', default='fast', help='preset of the node (fast)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    options = parser.parse_args()
    try:
        figures = measure(tuple(options.size), options.rate, options.seconds, options.preset)
    except DemoError as error:
        print(f'node_benchmark: {error}', file=sys.stderr)
        return 1
    latency = figures['latency_ms']
    print(f'{options.size[0]}x{options.size[1]} grey, preset {options.preset}: {figures["in_hz"]:.1f} Hz in, '
          f'{figures["out_hz"]:.1f} Hz out; from stamp to receipt p50 {latency["p50"]:.1f}, p90 {latency["p90"]:.1f}, '
          f'p99 {latency["p99"]:.1f} ms; the matcher took {figures["matcher_ms"]:.1f} ms of it')
    if options.json is not None:
        options.json.write_text(json.dumps(figures, indent=1) + '\n')
    return 0


if __name__ == '__main__':
    sys.exit(main())
