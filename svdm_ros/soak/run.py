"""The course of the soak: node and camera as processes, this one listens, asks and disturbs."""
from __future__ import annotations

import contextlib
import dataclasses
import os
import random
import signal
import tempfile
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import rclpy
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from stereo_msgs.msg import DisparityImage

from svdm_core.presets import load_preset, preset_folder

from ..node.parameter_set import NodeParameters, node_parameter_table
from ..processes.camera import SENT
from ..processes.children import Child, RunError, isolated_environment
from ..processes.dds_profile import write_profile
from ..processes.session import Session
from .good_pairs import differing, expected_answers, may_have_other_calibration, parse_frame_id
from .requests import outcome, request
from .tally import Tally

START_TIMEOUT, COMPILE_TIMEOUT = 60.0, 240.0  # s
_PRESET = 'fast'
_VARIATIONS: tuple[dict[str, Any], ...] = (
    {}, {'publish_filled': False}, {'alpha': 3.0, 'tau_lr': 0.5}, {'downscale': 2})
"""Changes of the preset, one after the other, under which answers are compared."""
_CALM = 4.0  # s in which answers are compared, in each round
_SETTLE = 0.5  # s after a change, in which answers to what was sent before may come
_STOPPED = 1.0  # s
_LONGEST_REASON = 300
_NUMBERS_A_CAMERA = 10**9
_NAMES = [info.name for info in node_parameter_table()]


@dataclasses.dataclass(frozen=True, slots=True)
class Settings:
    """seconds: how long. rate: pairs a second. hostile: messages after each pair. requests: to change parameters, in
    each round of about ten seconds."""

    seconds: float
    seed: int = 0
    rate: float = 20.0
    hostile: int = 2
    requests: int = 200


class Listener(Session):
    """Compares what it receives with `expected`, where that is set, and counts."""

    def __init__(self, check: Callable[[], None], tally: Tally) -> None:
        super().__init__(check)
        self._tally = tally
        self._start = time.monotonic()
        self._expected: list[DisparityImage] | None = None
        self._since = 0
        self.latencies_count = False

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._start

    def begin(self) -> None:
        """Count from now on."""
        self._tally.minutes.clear()
        self._tally.samples.clear()
        self._start = time.monotonic()

    def expect(self, answers: list[DisparityImage] | None) -> None:
        """From now on the answer of a pair that is sent is one of these; None: it may be any."""
        self._expected, self._since = answers, time.time_ns()

    def spend(self, seconds: float) -> None:
        """Receive for so long."""
        end = time.monotonic() + seconds
        self.wait_for(lambda: time.monotonic() >= end, seconds + 60, 'the clock stood still')

    def _take_disparity(self, message: DisparityImage) -> None:
        known = parse_frame_id(message.header.frame_id)
        if known is None:
            return
        number, pair, sent = known
        minute = self._tally.minute(self.seconds)
        minute.answered += 1
        if self.latencies_count and sent >= self._since:
            minute.latencies.append((time.time_ns() - sent) / 1e6)
        if self._expected is not None and sent >= self._since:
            minute.compared += 1
            wrong = differing(message, self._expected[pair])
            if may_have_other_calibration(sent, wrong):
                minute.other_calibration += 1
            elif wrong:
                minute.wrong += 1
                self._tally.fault('another answer than offline', f'{", ".join(wrong)} of pair {number}')

    def ask(self, changes: dict[str, Any]) -> tuple[bool, str]:
        """Request all changes together; whether they were taken, and the reason where not."""
        parameters = [Parameter(name, value=value) for name, value in changes.items()]
        future = self._parameters.set_parameters_atomically(parameters)
        self.wait_for(future.done, START_TIMEOUT, 'no answer to a request')
        result = future.result().result
        return result.successful, result.reason

    def values(self) -> dict[str, Any]:
        """All parameters as the node has them."""
        future = self._parameters.get_parameters(_NAMES)
        self.wait_for(future.done, START_TIMEOUT, 'no answer to a request')
        return dict(zip(_NAMES, map(parameter_value_to_python, future.result().values), strict=True))


class Soak:
    """Node, camera and listener of one run."""

    def __init__(self, settings: Settings, folder: Path, check: Callable[[], None]) -> None:
        self.tally = Tally()
        self._settings, self._folder, self._check = settings, folder, check
        self._chance = random.Random(settings.seed)
        self._cameras = 0
        preset = NodeParameters(matcher=load_preset(_PRESET))
        self._sets = [preset.replace(change) for change in _VARIATIONS]
        self._answers = [expected_answers(parameters) for parameters in self._sets]
        self._current = preset
        self._node = Child('node', folder / 'node.log', 'svdm_ros', '--ros-args', '--params-file',
                           str(preset_folder() / f'{_PRESET}.yaml'))
        self._camera: Child | None = None

    def run(self) -> None:
        """All rounds. Raises RunError where a process has died, and whatever `check` raises."""
        self._listener = Listener(self._look, self.tally)
        self._listener.wait_for_node(START_TIMEOUT)
        self._listener.wait_until_ready(COMPILE_TIMEOUT, 'the kernels were not ready')
        self._start_camera()
        self._listener.listen(START_TIMEOUT)
        self._listener.wait_for(lambda: self.tally.total('answered') > 0, START_TIMEOUT, 'no disparity image arrived')
        self._listener.begin()
        number = 0
        while self._listener.seconds < self._settings.seconds:
            self._compare(number % len(self._sets))
            self._chance.choice((self._stop_node, self._stop_camera, self._start_camera))()
            self._ask()
            number += 1

    def close(self) -> None:
        """End the processes; what the node's log tells of itself is a fault."""
        for child in (self._camera, self._node):
            if child is not None:
                child.send(signal.SIGCONT)
                child.stop()
        log = self._node.output()
        for sign in ('Traceback', 'by a defect of this node'):
            if sign in log:
                self.tally.fault(f'{sign} in the log of the node', log[max(0, log.index(sign) - 200):][:3000])

    def _look(self) -> None:
        """Called all the while: processes, memory, counts."""
        self._check()
        for child in (self._node, self._camera):
            if child is not None:
                try:
                    child.check()
                except RunError as error:
                    self.tally.deaths += 1
                    self.tally.fault('death', str(error))
                    raise
        seconds = self._listener.seconds
        if not self.tally.samples or seconds - self.tally.samples[-1][0] >= 1:
            pages = int(Path(f'/proc/{self._node.pid}/statm').read_text().split()[1])
            size = pages * os.sysconf('SC_PAGE_SIZE')
            self.tally.samples.append((seconds, size))
            minute = self.tally.minute(seconds)
            minute.rss.append(size)
            minute.sent += self._sent() - self.tally.total('sent')

    def _sent(self) -> int:
        return sum(log.read_text().count(SENT) for log in self._folder.glob('camera*.log'))

    def _start_camera(self) -> None:
        """A new one; the one before is ended."""
        if self._camera is not None:
            self._camera.stop()
        self._cameras += 1
        settings = self._settings
        self._camera = Child(
            'camera', self._folder / f'camera{self._cameras}.log', 'svdm_ros.soak.camera', '--rate', str(settings.rate),
            '--seed', str(settings.seed), '--hostile', str(settings.hostile),
            '--first', str(self._cameras * _NUMBERS_A_CAMERA))

    def _compare(self, index: int) -> None:
        """Answers under one of the sets are as they are offline."""
        wanted = self._sets[index]
        accepted, reason = self._listener.ask({name: wanted.value(name) for name in _NAMES})
        if not accepted:
            self.tally.fault('a set of parameters in range was refused', reason)
            return
        self._current = wanted
        self._listener.spend(_SETTLE)
        self._listener.expect(self._answers[index])
        self._listener.latencies_count = True
        self._listener.spend(_CALM)
        self._listener.latencies_count = False

    def _stop_node(self) -> None:
        self._stop(self._node)

    def _stop_camera(self) -> None:
        assert self._camera is not None
        self._stop(self._camera)

    def _stop(self, child: Child) -> None:
        child.send(signal.SIGSTOP)
        self._listener.spend(_STOPPED)
        child.send(signal.SIGCONT)
        self._listener.spend(_STOPPED)

    def _ask(self) -> None:
        """Requests in and out of range; each is taken as a whole or not at all."""
        self._listener.expect(None)
        for _ in range(self._settings.requests):
            changes = request(self._chance)
            after = outcome(self._current, changes)
            accepted, reason = self._listener.ask(changes)
            self.tally.minute(self._listener.seconds).requests += 1
            if accepted != (after is not None):
                kind = 'taken, and not to be taken' if accepted else 'refused, and not to be refused'
                self.tally.fault(kind, f'{changes!s:.300}: {reason:.300}')
            if len(reason) > _LONGEST_REASON:
                self.tally.fault('a reason that is too long', f'{len(reason)} characters: {reason!r:.300}')
            self._current = after if after is not None and accepted else self._current
        held = self._listener.values()
        for name in _NAMES:
            if held[name] != self._current.value(name):
                self.tally.fault('half-applied', f'{name} is {held[name]!r}, must be {self._current.value(name)!r}')


@contextlib.contextmanager
def soaking(settings: Settings, check: Callable[[], None]) -> Iterator[Soak]:
    """A run, whose processes are ended when it is left."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        os.environ.update(isolated_environment(
            folder / 'ros_log', write_profile(preset_folder() / 'fastdds.xml', folder / 'fastdds.xml')))
        soak = Soak(settings, folder, check)
        try:
            rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
            yield soak
        finally:
            soak.close()
            try_shutdown()
