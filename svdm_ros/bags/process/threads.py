"""Reading ahead and writing behind: one thread on either side of the work, with bounded queues between."""
from __future__ import annotations

import contextlib
import queue
import threading
from collections.abc import Callable, Generator, Iterable

_END = object()
_LOOK_S = 0.1
"""How often a thread that waits looks whether it is still wanted."""


def read_ahead[Item](items: Iterable[Item], size: int) -> Generator[Item, None, None]:
    """The items, up to `size` of them fetched in advance by a thread of its own; what it raises is raised here.

    Closing the iterator ends the thread.
    """
    waiting: queue.Queue[object] = queue.Queue(size)
    unwanted = threading.Event()
    failures: list[BaseException] = []

    def put(item: object) -> bool:
        while not unwanted.is_set():
            with contextlib.suppress(queue.Full):
                waiting.put(item, timeout=_LOOK_S)
                return True
        return False

    def fetch() -> None:
        try:
            all(put(item) for item in items)
        except BaseException as error:  # handed over, whatever it is
            failures.append(error)
        put(_END)

    thread = threading.Thread(target=fetch, name='reader', daemon=True)
    thread.start()
    try:
        while (item := waiting.get()) is not _END:
            yield item  # type: ignore[misc]
        if failures:
            raise failures[0]
    finally:
        unwanted.set()
        thread.join()


class WriteBehind[Item]:
    """Calls `write(item)` for each item in a thread of its own, in order; at most `size` items wait.

    After `write` has raised nothing more is written, and the next `put` or `close` raises the same.
    """

    def __init__(self, write: Callable[[Item], None], size: int) -> None:
        self._write = write
        self._waiting: queue.Queue[object] = queue.Queue(size)
        self._failure: BaseException | None = None
        self._thread = threading.Thread(target=self._run, name='writer', daemon=True)
        self._thread.start()

    def put(self, item: Item) -> None:
        """Leave an item; waits while the queue is full."""
        if self._failure:
            raise self._failure
        self._waiting.put(item)

    def close(self) -> None:
        """Wait until all is written."""
        self._waiting.put(_END)
        self._thread.join()
        if self._failure:
            raise self._failure

    def _run(self) -> None:
        while (item := self._waiting.get()) is not _END:
            if self._failure is None:
                try:
                    self._write(item)  # type: ignore[arg-type]
                except BaseException as error:  # handed over, whatever it is
                    self._failure = error
