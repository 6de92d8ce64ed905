"""What the node says, how often, and what its diagnostics tell of it meanwhile. Free of ROS."""
from __future__ import annotations

import contextlib
import dataclasses
import math
import threading
import time
from collections.abc import Iterator
from typing import Protocol

from svdm_core.shown import line as one_line

_MOST_LINES = 100
_TROUBLE_LASTS = 3.0
"""Seconds for which diagnostics tell of a trouble after it was last met."""


@dataclasses.dataclass(frozen=True, slots=True)
class Line:
    """A line to log; lines of the same `kind` are about the same trouble."""

    kind: str
    text: str

    def __post_init__(self) -> None:
        # A traceback has several.
        object.__setattr__(self, 'text', '\n'.join(map(one_line, self.text.split('\n')[:_MOST_LINES])))


class Throttle:
    """Lets a line of each kind through at most once in `period` seconds. Safe to use from any thread."""

    def __init__(self, period: float = 10.0) -> None:
        self._period = period
        self._lock = threading.Lock()
        self._said: dict[str, float] = {}
        self._held_back: dict[str, int] = {}

    def admit(self, line: Line, now: float) -> str | None:
        """The text to log at `now` (s), with the number of lines of its kind held back before; None: hold it back."""
        with self._lock:
            said = self._said.get(line.kind)
            if said is not None and now - said < self._period:
                self._held_back[line.kind] = self._held_back.get(line.kind, 0) + 1
                return None
            self._said[line.kind] = now
            held_back = self._held_back.pop(line.kind, 0)
        return f'{line.text} ({held_back} times more since the last such line)' if held_back else line.text


class Logger(Protocol):
    """As rclpy has it."""

    def info(self, message: str) -> bool: ...
    def warning(self, message: str) -> bool: ...
    def error(self, message: str) -> bool: ...


class LogLines:
    """Lines that come once in ten seconds at most, and troubles that are told when they begin and when they end.

    `last` is for one thread, all else for any.
    """

    def __init__(self, logger: Logger) -> None:
        self._logger = logger
        self._throttle = Throttle()
        self._met: tuple[float, str] = (-math.inf, '')
        self._lasting: dict[str, str] = {}

    @property
    def trouble(self) -> str:
        """What diagnostics tell: the last complaint while it is recent, else the first trouble that lasts; or empty."""
        since, text = self._met
        if time.monotonic() - since < _TROUBLE_LASTS:
            return text
        return next(iter(self._lasting.values()), '')

    def complain(self, line: Line) -> None:
        """A warning, of which diagnostics tell for some seconds."""
        self._met = (time.monotonic(), line.text)
        if (text := self._admitted(line)) is not None:
            self._logger.warning(text)

    def say(self, line: Line) -> None:
        if (text := self._admitted(line)) is not None:
            self._logger.info(text)

    def inform(self, text: str) -> None:
        """Said each time."""
        self._logger.info(text)

    def alarm(self, line: Line) -> None:
        """An error."""
        if (text := self._admitted(line)) is not None:
            self._logger.error(text)

    def last(self, line: Line, over: str) -> None:
        """A trouble that lasts until its line has no text: a warning when it begins, `over` when it has ended."""
        if line.text and line.kind not in self._lasting:
            self._logger.warning(line.text)
        if line.text:
            self._lasting[line.kind] = line.text
        elif self._lasting.pop(line.kind, ''):
            self._logger.info(over)

    def forget(self) -> None:
        """The troubles that last are over, without a word: what they were about is there no more."""
        self._lasting.clear()

    @contextlib.contextmanager
    def complaining(self, kind: str) -> Iterator[None]:
        """A ValueError becomes a line, and the node goes on."""
        try:
            yield
        except ValueError as error:
            self.complain(Line(kind, str(error)))

    def _admitted(self, line: Line) -> str | None:
        return self._throttle.admit(line, time.monotonic())
