"""SIGINT and SIGTERM end the process quietly with exit code 0. Imports nothing that takes time."""
from __future__ import annotations

import os
import signal
from types import FrameType

_NUMBERS = (signal.SIGINT, signal.SIGTERM)


class EndSignals:
    """What a signal does: it ends the process at once, until somebody else is there to end it in order.

    `received` tells whether one has come.
    """

    def __init__(self) -> None:
        self.received = False
        self._orderly = False
        for number in _NUMBERS:
            signal.signal(number, self._on_signal)

    def leave_to_rclpy(self) -> None:
        """To be called once `rclpy.init` is done: its handlers then shut the context down, which ends the node."""
        self._orderly = True

    def ignore(self) -> None:
        """To be called when the end has begun: there is nothing left to ask for."""
        for number in _NUMBERS:
            signal.signal(number, signal.SIG_IGN)

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        self.received = True
        if not self._orderly:
            os._exit(0)  # no exception: whatever is being imported might catch it, or end in a traceback
