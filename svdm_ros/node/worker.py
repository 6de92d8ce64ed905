"""A thread that works beside the executor's, fed through a mailbox that holds the newest job, now and then two."""
from __future__ import annotations

import collections
import contextlib
import math
import threading
import time
from collections.abc import Callable

_LOOK_AGAIN = 0.1  # s
_SPARE_EACH = 1.0
"""s after which a second job may wait again: a process that was held up for a moment loses nothing, and one that is too
slow is never more than one job behind."""


class Worker[Job]:
    """Calls `prepare()` once and then `process(job)` for each job, all in one thread of its own.

    A matcher takes one frame at a time, and nobody else is to wait for it; nor for a measurement of rows.
    A job that is still waiting when the next one comes is replaced; but once a second, both wait. Jobs begin `period()`
    seconds apart at least.
    `on_drop(reason)` is called for each job that is not processed, `on_error(exception)` for whatever `prepare` or
    `process` raises: the thread goes on.
    """

    def __init__(
        self,
        prepare: Callable[[], None],
        process: Callable[[Job], None],
        on_drop: Callable[[str], None],
        on_error: Callable[[Exception], None],
        period: Callable[[], float] = lambda: 0.0,
        name: str = 'matcher',
    ) -> None:
        """name: of the thread."""
        self._prepare = prepare
        self._process = process
        self._on_drop = on_drop
        self._on_error = on_error
        self._period = period
        self._begun = -math.inf
        self._waiting: collections.deque[Job] = collections.deque()
        self._spared = -math.inf
        self._ready = False
        self._stopping = False
        self._wake = threading.Condition()
        # A daemon: a compilation cannot be interrupted, and the process must be able to end during one.
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    @property
    def ready(self) -> bool:
        """Whether `prepare` is done."""
        return self._ready

    def start(self) -> None:
        self._thread.start()

    def submit(self, job: Job) -> None:
        """Leave a job in the mailbox; never waits."""
        with self._wake:
            if not self._ready:
                reasons = ['before warm-up']
            else:
                reasons = self._make_room()
                self._waiting.append(job)
                self._wake.notify()
        for reason in reasons:
            self._on_drop(reason)

    def _make_room(self) -> list[str]:
        """Take out of the mailbox what a new job replaces; why, of each."""
        if not self._waiting:
            return []
        early, now = self._early() > 0, time.monotonic()
        if not early and len(self._waiting) == 1 and now - self._spared >= _SPARE_EACH:
            self._spared = now
            return []
        reasons = ['above max_rate' if early else 'superseded'] * len(self._waiting)
        self._waiting.clear()
        return reasons

    def stop(self, timeout: float) -> bool:
        """Ask the thread to end after the job in hand; True if it did within `timeout` seconds."""
        with self._wake:
            self._stopping = True
            self._wake.notify()
        if self._thread.is_alive():
            self._thread.join(timeout)
        return not self._thread.is_alive()

    def _run(self) -> None:
        self._guarded(self._prepare)
        with self._wake:
            self._ready = True
        while (job := self._next_job()) is not None:
            self._guarded(self._process, job)

    def _next_job(self) -> Job | None:
        """The job that has waited longest, or None when the worker is to stop."""
        with self._wake:
            self._wake.wait_for(lambda: self._stopping or bool(self._waiting))
            while not self._stopping and (early := self._early()) > 0:
                # Meanwhile the waiting job is replaced by newer ones, and the period may change.
                self._wake.wait(min(early, _LOOK_AGAIN))
            self._begun = time.monotonic()
            return None if self._stopping else self._waiting.popleft()

    def _early(self) -> float:
        """Seconds until the next job may begin."""
        return self._begun + self._period() - time.monotonic()

    def _guarded(self, work: Callable[..., None], *arguments: Job) -> None:
        try:
            work(*arguments)
        except Exception as error:  # the last barrier: a thread that dies of one frame would die silently
            with contextlib.suppress(MemoryError):
                self._on_error(error)
