"""The course of the soak: node and camera as processes, this one listens, asks and disturbs."""
from __future__ import annotations

import contextlib
import dataclasses
import os
import random
import signal
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import rclpy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown

from svdm_core.presets import load_preset, preset_folder

from ..node.parameter_set import NodeParameters
from ..processes.camera import SENT
from ..processes.children import Child, RunError, isolated_environment
from ..processes.dds_profile import write_profile
from .good_pairs import Size, expected_answers
from .listener import NAMES, START_TIMEOUT, Listener
from .requests import outcome, request
from .tally import Tally

COMPILE_TIMEOUT = 240.0  # s
_PRESET = 'fast'
_VARIATIONS: tuple[dict[str, Any], ...] = (
    {}, {'publish_filled': False}, {'alpha': 3.0, 'tau_lr': 0.5}, {'downscale': 2})
"""Changes of the preset, one after the other, under which answers are compared."""
_COMPARABLE = {'align_rows': 'off'}
"""What the node measures in hostile pairs, too, may change the answers."""
_CALM = 4.0  # s in which answers are compared, in each round
_SETTLE = 0.5  # s after a change, in which answers to what was sent before may come
_STOPPED = 1.0  # s
_LONGEST_REASON = 300
_NUMBERS_A_CAMERA = 10**9
_DRAIN = 10.0  # s after the last pair, in which it is answered and counted: the node tells its counts once a second


@dataclasses.dataclass(frozen=True, slots=True)
class Settings:
    """seconds: how long. size: of the good pairs. rate: pairs a second. steady: nothing disturbs the node, and hostile
    and requests do not count. hostile: messages after each pair. requests: to change parameters, in each round of about
    ten seconds."""

    seconds: float
    seed: int = 0
    size: Size = (320, 240)
    rate: float = 20.0
    steady: bool = False
    hostile: int = 2
    requests: int = 200


class Soak:
    """Node, camera and listener of one run."""

    def __init__(self, settings: Settings, folder: Path, check: Callable[[], None]) -> None:
        """Raises ValueError where the pairs are too small."""
        self.tally = Tally()
        self._settings, self._folder, self._check = settings, folder, check
        self._hostile = 0 if settings.steady else settings.hostile
        self._chance = random.Random(settings.seed)
        self._cameras = 0
        preset = NodeParameters(matcher=load_preset(_PRESET))
        self._sets = [preset.replace(_COMPARABLE | change) for change in _VARIATIONS]
        self._answers = [expected_answers(parameters, settings.size)
                         for parameters in (self._sets[:1] if settings.steady else self._sets)]
        self._current = preset
        self._node = Child('node', folder / 'node.log', 'svdm_ros', '--ros-args', '--params-file',
                           str(preset_folder() / f'{_PRESET}.yaml'))
        self._camera: Child | None = None

    def run(self) -> None:
        """All of it. Raises RunError where a process has died, and whatever `check` raises."""
        self._listener = Listener(self._look, self.tally, self._hostile > 0)
        self._listener.wait_for_node(START_TIMEOUT)
        self._listener.wait_until_ready(COMPILE_TIMEOUT, 'the kernels were not ready')
        self._start_camera()
        self._listener.listen(START_TIMEOUT)
        self._listener.wait_for(lambda: self.tally.total('answered') > 0, START_TIMEOUT, 'no disparity image arrived')
        self._listener.begin()
        if self._settings.steady:
            self._go_on()
        else:
            self._disturb()

    def _go_on(self) -> None:
        """Answers are compared all the while; then what the node has counted is noted."""
        self._listener.expect(self._answers[0])
        self._listener.latencies_count = True
        self._listener.spend(self._settings.seconds)
        assert self._camera is not None
        self._camera.stop()
        self._camera = None
        self._sample()
        self._listener.drain(self.tally.total('sent'), _DRAIN)
        self.tally.pairs, self.tally.published = map(self._listener.count, ('pairs', 'published'))
        self.tally.dropped = self._listener.dropped()

    def _disturb(self) -> None:
        """Round after round."""
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
        samples = self.tally.samples
        if self._camera is not None and (not samples or self._listener.seconds - samples[-1][0] >= 1):
            self._sample()

    def _sample(self) -> None:
        """Memory of the node, and pairs sent."""
        pages = int(Path(f'/proc/{self._node.pid}/statm').read_text().split()[1])
        size = pages * os.sysconf('SC_PAGE_SIZE')
        seconds = self._listener.seconds
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
            '--seed', str(settings.seed), '--hostile', str(self._hostile), '--size', '{}x{}'.format(*settings.size),
            '--first', str(self._cameras * _NUMBERS_A_CAMERA))

    def _compare(self, index: int) -> None:
        """Answers under one of the sets are as they are offline."""
        wanted = self._sets[index]
        accepted, reason = self._listener.ask({name: wanted.value(name) for name in NAMES})
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
        for name in NAMES:
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
