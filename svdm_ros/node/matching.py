"""The worker's thread: each pair is matched with the parameters of the moment, and published."""
from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable

from svdm_core.memory import is_out_of_memory

from ..frames.frame_processing import FrameProcessor, ProcessedFrame
from ..frames.matched_frame import MatchedFrame
from ..frames.views import FrameError, StereoFrame
from .camera_infos import CameraInfos
from .failures import Failures
from .frame_statistics import FrameStatistics, PixelShares
from .log_lines import Line, LogLines
from .parameter_set import NodeParameters
from .row_watch import RowWatch
from .worker import Worker

_INFO_PATIENCE = 2.0
"""Seconds from the first pair on in which camera_info is not missed yet."""


class Matching:
    """Takes pairs from the node's thread."""

    def __init__(self, log: LogLines, statistics: FrameStatistics, infos: CameraInfos,
                 publish: Callable[[MatchedFrame], None], parameters: Callable[[], NodeParameters],
                 is_up: Callable[[], bool]) -> None:
        """parameters: those of now. is_up: whether rclpy is, as what fails while it is shut down is no failure."""
        self._log, self._statistics, self._infos = log, statistics, infos
        self._publish, self._parameters, self._is_up = publish, parameters, is_up
        self._failures = Failures(statistics, log)
        self.rows = RowWatch(log, self._report_row_failure)
        self._processor = FrameProcessor(self._report_compiling, self.rows)
        self._worker: Worker[StereoFrame] = Worker(
            self._warm_up, self._process, statistics.count_drop, self._report_failure, lambda: parameters().period)
        self._first, self._early = math.inf, Line('', '')
        self._compiling = self._hint = ''

    @property
    def warm(self) -> bool:
        """Whether the kernels of the start are there."""
        return self._worker.ready

    @property
    def compiling(self) -> bool:
        """Whether kernels are being compiled, and nothing comes out."""
        return not self._worker.ready or bool(self._compiling)

    def start(self) -> None:
        self.rows.start()
        self._worker.start()

    def stop(self, timeout: float) -> bool:
        """As the worker's; of both threads."""
        has_ended = self._worker.stop(timeout)
        return self.rows.stop(timeout) and has_ended

    def submit(self, frame: StereoFrame) -> None:
        """A pair without its camera_info, which may still come while the pair waits."""
        self._first = min(self._first, frame.arrived)
        self._worker.submit(frame)

    def tell_missing_infos(self) -> None:
        """Of a pair that came early; to be called now and then."""
        if self._early.text and not self._is_early():
            if None in self._infos.latest_of_both():
                self._log.complain(self._early)
            self._early = Line('', '')

    def _is_early(self) -> bool:
        return time.monotonic() - self._first < _INFO_PATIENCE

    def _warm_up(self) -> None:
        self._log.inform('compiling the kernels, up to a minute the first time')
        start = time.monotonic()
        self._processor.warm_up(self._parameters())
        if self._is_up():  # else the process is ending, and a line could not be published
            self._log.inform(f'ready: kernels compiled or loaded in {time.monotonic() - start:.1f} s')

    def _process(self, frame: StereoFrame) -> None:
        frame = dataclasses.replace(frame, left_info=self._infos.of('left', frame.left.header.stamp),
                                    right_info=self._infos.of('right', frame.right.header.stamp))
        try:
            done = self._processor.process(frame, self._parameters())
        except FrameError as error:
            self._statistics.count_drop(error.reason)
            self._log.complain(Line(error.reason, str(error)))
            return
        finally:
            self._say_compiled()
        self._publish(done.frame)
        shares = PixelShares(done.frame.valid_share, done.frame.confident_share)
        self._statistics.count_published(time.monotonic() - frame.arrived, done.timings, shares)
        self._tell(done, None in (frame.left_info, frame.right_info))

    def _tell(self, done: ProcessedFrame, lacks_info: bool) -> None:
        if done.hint != self._hint:  # said once: it is no fault
            self._hint = done.hint
            if done.hint:
                self._log.inform(done.hint)
        if done.problem:
            geometry = done.frame.geometry
            known = f'f = {geometry.focal_length:g}, t = {geometry.baseline:g}'
            line = Line('published', f'disparity published with {known}: {done.problem}')
            if lacks_info and self._is_early():
                self._early = line
            else:
                self._log.complain(line)

    def _report_compiling(self, what: str) -> None:
        self._compiling = what
        text = f'new parameters or images: compiling the kernels for {what}, nothing comes out for up to a minute'
        self._log.say(Line(f'compiling {what}', text))

    def _say_compiled(self) -> None:
        if self._compiling:
            what = self._compiling
            self._log.say(Line(f'compiled {what}', f'ready: kernels compiled or loaded for {what}'))
            self._compiling = ''

    def _report_row_failure(self, error: Exception) -> None:
        if self._is_up():
            if is_out_of_memory(error):
                self._failures.no_memory('rows not measured', error)
            else:
                self._failures.defect('rows not measured', error)

    def _report_failure(self, error: Exception) -> None:
        if not self._is_up():
            return  # the end of the process, seen from the worker
        if is_out_of_memory(error):
            self._failures.no_memory('pair dropped', error)
        elif self._worker.ready:
            self._statistics.count_drop('failed')
            self._failures.defect('frame dropped', error)
        else:
            self._failures.defect('warm-up cut short, the first pairs take longer', error)
