"""How far rows are apart, measured beside the matcher in a thread of its own, so that no frame waits for it."""
from __future__ import annotations

import math
import os
import sys
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

from numpy.typing import NDArray

from svdm_core import RowAlignment, RowTracker
from svdm_core.row_alignment.alignment import LARGEST_SIDE
from svdm_core.row_alignment.tracking import LOOKS

from ..frames.frame_preparation import PreparedFrame
from ..frames.row_offsets import RectificationCheck
from .log_lines import Line, LogLines
from .worker import Worker

_PERIOD = 1.0
"""Least seconds between two looks, of 20 to 60 ms each."""
_NICENESS = 10
"""Of the thread: where processors are scarce, the matcher's threads go first."""


class _Watched:
    """What is known of the cameras as they are set now; another setting has another object, so that what a look finds
    of an earlier one is lost with it."""

    def __init__(self, setting: object, mode: str, search: tuple[int, int]) -> None:
        self.setting, self.mode = setting, mode
        self.search = search
        self.tracker = RowTracker(*search)
        self.check = RectificationCheck()
        self.looks = 0
        self.rows: RowAlignment | None = None

    @property
    def is_tracking(self) -> bool:
        """Whether the tracker is to see more pairs."""
        return self.mode == 'track' or (
            self.mode == 'once' and (self.tracker.alignment is None or self.looks < LOOKS))


class _Look(NamedTuple):
    """A pair to be measured, and when it came, s."""

    watched: _Watched
    left: NDArray[Any]
    right: NDArray[Any]
    arrived: float


class RowWatch:
    """Measures a pair now and then: for the row alignment, and to tell when the rows do not correspond.

    Calling it is for the matcher's thread; all else is for any.
    """

    def __init__(self, log: LogLines, on_error: Callable[[Exception], None]) -> None:
        """on_error: told of what goes wrong in the thread, which goes on."""
        self._log = log
        self._watched = _Watched(None, 'off', (0, 1))
        self._next = -math.inf
        self._busy = False
        self._worker: Worker[_Look] = Worker(_step_back, self._look, self._drop, on_error, name='rows')

    @property
    def is_busy(self) -> bool:
        """Whether a pair is being measured, and others are left out."""
        return self._busy

    def start(self) -> None:
        self._worker.start()

    def stop(self, timeout: float) -> bool:
        """As the worker's."""
        return self._worker.stop(timeout)

    def __call__(self, frame: PreparedFrame) -> RowAlignment | None:
        """By what the rows of this pair are aligned; never waits. The pair is measured if it is time to."""
        mode, setting = frame.parameters.align_rows, frame.row_setting
        watched = self._watched
        if setting != watched.setting or (mode == 'off') != (watched.mode == 'off'):
            if watched.rows is not None and mode != 'off':
                self._log.say(Line('rows dropped', 'the row alignment is dropped, and measured anew: camera_info, or '
                                                   'the part, size or search range of the images has changed'))
            self._watched = watched = _Watched(setting, mode, frame.search)
        watched.mode = mode
        if not self._busy and frame.arrived >= self._next and (
                watched.is_tracking or watched.check.is_due(frame.arrived)):
            self._next = frame.arrived + _PERIOD
            self._busy = True
            self._worker.submit(_Look(watched, frame.pair.left, frame.pair.right, frame.arrived))
        return watched.rows

    def line(self, now: float) -> str:
        """As `RectificationCheck.line`, of what is left after the alignment."""
        watched = self._watched
        return watched.check.line(now, watched.rows)

    def values(self) -> dict[str, str]:
        """For diagnostics: the mode, and the alignment where there is one."""
        watched = self._watched
        rows = watched.rows
        values = watched.check.values(rows)
        if watched.setting is not None:
            values['row alignment'] = watched.mode
        if rows is not None:
            values |= {f'row alignment {place} (px)': f'{dy:.2f}' for place, dy in rows.places().items()}
            values |= {'row alignment points': str(rows.points),
                       'row alignment residual before (px)': f'{rows.residual_before:.2f}',
                       'row alignment residual after (px)': f'{rows.residual_after:.2f}'}
        return values

    # In the thread

    def _look(self, look: _Look) -> None:
        try:
            watched, pair = look.watched, (look.left, look.right)
            if watched.check.is_due(look.arrived):
                low, count = watched.search
                watched.check.look(*pair, (low, low + count - 1), look.arrived)
            if watched.is_tracking and max(look.left.shape[:2]) <= LARGEST_SIDE:
                self._track(watched, *pair)
        finally:
            self._busy = False

    def _track(self, watched: _Watched, left: NDArray[Any], right: NDArray[Any]) -> None:
        has_changed = watched.tracker.look(left, right)
        watched.looks += 1
        rows = watched.tracker.alignment
        if not has_changed or rows is None:
            return
        rows.apply(right)  # the first time makes the map, which no frame is to wait for
        watched.rows = None if rows.is_identity else rows
        if watched is self._watched:
            self._log.say(Line('rows aligned', 'rows correspond: they are aligned no longer' if rows.is_identity else
                                               f'rows aligned, {rows.line()}'))

    def _drop(self, _reason: str) -> None:
        self._busy = False


def _step_back() -> None:
    """This thread goes last where processors are scarce; elsewhere than in Linux niceness is of whole processes."""
    if sys.platform == 'linux':
        os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), _NICENESS)
