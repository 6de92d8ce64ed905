"""Pairs of a recording or of two files, matched in this process: no ROS is needed."""
from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Callable, Generator, Mapping
from typing import NamedTuple, Protocol

from svdm_core import RowAlignment
from svdm_core.kernels.arrays import Float32
from svdm_core.missing_modules import missing_line
from svdm_core.shown import line

from ..frames.frame_preparation import PreparedFrame
from ..frames.frame_processing import FrameProcessor, ProcessedFrame
from ..frames.views import StereoFrame
from ..node.parameter_set import NodeParameters, Value, node_parameter_table
from .live_figures import LiveFigures
from .shot import Shot

_LONGEST_WAIT = 1.0
"""s; gaps of a recording that are longer are cut."""


class FedPair(NamedTuple):
    """truth: float32 (H, W), px, not finite where unknown; None where there is none. time: s, of the recording."""

    frame: StereoFrame
    truth: Float32 | None
    time: float


class Rows(Protocol):
    """By what a pair's rows are aligned, and what is told of it."""

    def __call__(self, frame: PreparedFrame) -> RowAlignment | None: ...
    def figures(self) -> dict[str, str]: ...


class LocalSource:
    """A Source whose thread matches the pairs of `feed` as they come due, and the last one anew when a parameter
    changes."""

    def __init__(
        self, title: str, feed: Callable[[], Generator[FedPair]], parameters: NodeParameters, rows: Rows, *,
        plays: bool,
    ) -> None:
        """feed: begun in the thread; without end. plays: whether its pairs differ."""
        self.title, self.plays = title, plays
        self._feed, self._rows = feed, rows
        self._parameters = parameters
        self._processor = FrameProcessor(self._tell_compiling, rows)
        self._figures = LiveFigures()
        self._told: dict[str, str] = {}
        self._trouble = 'the first pair is being read, and the kernels loaded: up to a minute, the first time'
        self._end = ''
        self._shot: Shot | None = None
        self._fed: FedPair | None = None
        self._playing, self._steps, self._stopping = True, 0, False
        self._wake = threading.Condition()
        self._thread = threading.Thread(target=self._run, name='tuner', daemon=True)

    # For any thread

    def start(self) -> None:
        self._thread.start()

    def stop(self) -> None:
        with self._wake:
            self._stopping = True
            self._wake.notify()
        self._thread.join(1.0)

    def values(self) -> Mapping[str, Value]:
        parameters = self._parameters
        return {info.name: parameters.value(info.name) for info in node_parameter_table()}

    def change(self, values: Mapping[str, Value]) -> str:
        with self._wake:
            if self._end:
                return f'nothing is matched any more: {self._end}'
            try:
                self._parameters = self._parameters.replace(values)
            except ValueError as error:
                return str(error)
            self._wake.notify()
        return ''

    def latest(self) -> Shot | None:
        return self._shot

    def figures(self) -> Mapping[str, str]:
        return self._told

    def trouble(self) -> str:
        return self._end or self._trouble

    def hold(self) -> StereoFrame | None:
        fed = self._fed
        return None if fed is None else fed.frame

    @property
    def is_playing(self) -> bool:
        return self._playing

    def play(self, *, on: bool) -> None:
        with self._wake:
            self._playing = on
            self._wake.notify()

    def step(self) -> None:
        with self._wake:
            self._playing = False
            self._steps += 1
            self._wake.notify()

    # In the thread

    def _run(self) -> None:
        try:
            with contextlib.closing(self._feed()) as feed:
                self._show(feed)
        except StopIteration:
            self._end = 'there is no pair to be shown'
        except ImportError as error:
            self._end = missing_line(error)
        except Exception as error:  # the last barrier: a thread that dies would die silently
            self._end = line(error) or type(error).__name__

    def _show(self, feed: Generator[FedPair]) -> None:
        fed, following = next(feed), next(feed) if self.plays else None
        self._processor.warm_up(self._parameters)  # else the first pair would tell the time of loading kernels
        is_new = True
        while True:
            begun, parameters = time.monotonic(), self._parameters
            self._fed = fed
            self._process(fed, parameters, is_new=is_new)
            gap = 0.0 if following is None else following.time - fed.time
            goes_on = self._wait(parameters, begun + min(max(gap, 0.0), _LONGEST_WAIT))
            if goes_on is None:
                return
            is_new = goes_on and following is not None
            if goes_on and following is not None:
                fed, following = following, next(feed)

    def _wait(self, parameters: NodeParameters, due: float) -> bool | None:
        """True for the next pair, False for the same once more, None for the end."""
        with self._wake:
            while not self._stopping:
                if self._parameters is not parameters:
                    return False
                if self._steps:
                    self._steps -= 1
                    return True
                left = due - time.monotonic()
                goes_on = self.plays and self._playing
                if goes_on and left <= 0:
                    return True
                self._wake.wait(left if goes_on else None)
            return None

    def _process(self, fed: FedPair, parameters: NodeParameters, *, is_new: bool) -> None:
        try:
            done = self._processor.process(fed.frame, parameters)
        except Exception as error:  # of this pair, with these parameters: others may do
            self._trouble = line(error) or type(error).__name__
            return
        number = 1 if self._shot is None else self._shot.number + 1
        shot = Shot.of(done.frame, number, fed.truth, is_moving=is_new)
        self._shot = shot
        self._trouble = _problem(done, fed.frame)
        self._told = self._figures_of(done, shot, parameters)

    def _figures_of(self, done: ProcessedFrame, shot: Shot, parameters: NodeParameters) -> dict[str, str]:
        rate = self._figures.rate() if shot.is_moving and self.plays else ''
        stages = {stage: f'{milliseconds:.1f} ms' for stage, milliseconds in done.timings.items()}
        return {'time of a frame': stages.pop('total', ''), **stages, **({'rate': rate} if rate else {}),
                'valid pixels': f'{100 * done.frame.valid_share:.1f} %',
                'trusted pixels': f'{100 * float(shot.trusted.mean()):.1f} %',
                **self._rows.figures(), **self._figures.of(shot, parameters)}

    def _tell_compiling(self, what: str) -> None:
        self._trouble = f'compiling the kernels for {what}: up to a minute, the first time'


def _problem(done: ProcessedFrame, frame: StereoFrame) -> str:
    """Without what lacks where no depth is asked for: images from files have no camera_info."""
    if frame.left_info is not None or frame.right_info is not None:
        return done.problem
    return done.problem.removeprefix(done.frame.geometry.problem).removeprefix('; ')
