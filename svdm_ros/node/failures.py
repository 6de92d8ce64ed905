"""What is said and counted of exceptions: a defect, memory that is used up, a message that rclpy cannot take."""
from __future__ import annotations

import traceback

from svdm_core.memory import lacking_text

from .frame_statistics import FrameStatistics
from .log_lines import Line, LogLines


class Failures:
    """May be told of from any thread."""

    def __init__(self, statistics: FrameStatistics, log: LogLines) -> None:
        self._statistics, self._log = statistics, log

    def defect(self, what: str, error: Exception) -> None:
        """An exception that nothing accounts for, logged with its traceback."""
        self._statistics.count_defect()
        details = ''.join(traceback.format_exception(error))
        self._log.complain(Line(what, f'{what} by a defect of this node, please report it: {details}'))

    def no_memory(self, what: str, error: Exception) -> None:
        """What was lost as memory was used up."""
        self._statistics.count_drop('no memory')
        self._log.complain(Line('no memory', f'{what}: {lacking_text(error)}'))

    def untaken(self, error: Exception) -> None:
        """A message that rclpy could not make of what came."""
        self._statistics.count_drop('not taken')
        self._log.complain(Line('not taken', f'message dropped, rclpy cannot take it: {lacking_text(error)}: look at '
                                             'its size, and how much memory is free'))
