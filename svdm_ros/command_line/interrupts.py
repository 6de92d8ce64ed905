"""SIGINT and SIGTERM while threads are at work: they wait for a moment at which an exception harms nothing."""
from __future__ import annotations

import contextlib
import signal
import threading
from collections.abc import Callable, Iterator
from types import FrameType

_SIGNALS = (signal.SIGINT, signal.SIGTERM)


@contextlib.contextmanager
def deferred_interrupts() -> Iterator[Callable[[], None]]:
    """Yields what raises KeyboardInterrupt if a signal has come; leaving does the same. A signal alone raises nothing.

    Raised at any other moment, say within a queue, it could leave a lock that is never released. Signals that are
    ignored stay so. Outside the main thread, where Python runs no signal handlers, nothing is changed.
    """
    came: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        came.append(number)

    def check() -> None:
        if came:
            raise KeyboardInterrupt

    is_main = threading.current_thread() is threading.main_thread()
    earlier = {number: signal.getsignal(number) for number in _SIGNALS} if is_main else {}
    changed = {number: handler for number, handler in earlier.items() if callable(handler)}
    for number in changed:
        signal.signal(number, note)
    try:
        yield check
    finally:
        for number, handler in changed.items():
            signal.signal(number, handler)
    check()
