"""SIGINT and SIGTERM end the process quietly. Imports nothing that takes time."""
from __future__ import annotations

import os
import signal
from types import FrameType

_NUMBERS = (signal.SIGINT, signal.SIGTERM)


class EndSignals:
    """What a signal does: it ends the process at once, until somebody else is there to end it in order.

    code: the exit code then. received: whether a signal has come.
    """

    def __init__(self, code: int = 0) -> None:
        self.code = code
        self.received = False
        self._orderly = False
        for number in _NUMBERS:
            signal.signal(number, self._on_signal)

    def end_in_order(self) -> None:
        """To be called once somebody else ends the process after a signal: rclpy, whose handlers shut the context down,
        or whoever looks at `received`.
        """
        self._orderly = True

    def ignore(self) -> None:
        """To be called when the end has begun: there is nothing left to ask for."""
        for number in _NUMBERS:
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.received = True
        if not self._orderly:
            os._exit(self.code)  # no exception: whatever is being imported might catch it, or end in a traceback
