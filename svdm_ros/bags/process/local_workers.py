"""Many recordings on this machine: one at a time a process, each bag for itself.

The processes speak through pairs of connected sockets that have no name and no port: nobody else can reach them.
"""
from __future__ import annotations

import contextlib
import multiprocessing
import os
import signal
import threading
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from multiprocessing import resource_tracker
from multiprocessing.connection import Connection, wait
from types import FrameType

from svdm_core.runtime import configure

from .outcome import Outcome, outcome_of
from .processing import Job, Tell

_END_SIGNALS = (signal.SIGINT, signal.SIGTERM)
_ATTEMPTS = 3
"""A recording whose process is killed is gone on with in another one, up to so many in all."""


def process_locally(jobs: Sequence[Job], workers: int, teller: Callable[[str], Tell]) -> Generator[Outcome, None, None]:
    """Process every job, in as many processes as `workers`, and give what came of it as soon as it is known.

    The processes divide the processors among them. `teller(name)` makes what is told of the progress. Closing the
    iterator ends the processes, which keep what they have done.
    """
    tellers = {job.output: teller(job.input.name) for job in jobs}
    waiting = deque((job, 1) for job in jobs)
    with contextlib.closing(_Pool(min(workers, len(jobs)))) as pool:
        while waiting or pool.busy:
            while waiting and pool.has_room:
                pool.give(*waiting.popleft())
            for job, attempt, message in pool.heard():
                if isinstance(message, tuple):
                    tellers[job.output](*message)
                elif isinstance(message, Outcome):
                    yield message
                elif message < 0 and attempt < _ATTEMPTS:  # killed
                    waiting.append((job, attempt + 1))
                else:
                    yield Outcome(str(job.input), [], _told_of_end(job, message), 2)


def _told_of_end(job: Job, exit_code: int) -> str:
    if exit_code < 0:
        return (f'{job.input}: its process was killed by {signal.Signals(-exit_code).name}, {_ATTEMPTS} times: see '
                'that there is memory enough, then the same command goes on from there')
    return (f'{job.input}: its process ended with exit code {exit_code}; the traceback above is a defect, please '
            'report it')


class _Pool:
    """Processes, begun as they are needed."""

    def __init__(self, workers: int) -> None:
        self._workers = workers
        self._threads = max(len(os.sched_getaffinity(0)) // workers, 1)
        self._idle: list[_Worker] = []
        self.busy: list[_Worker] = []

    @property
    def has_room(self) -> bool:
        """Whether one more job can be begun."""
        return len(self.busy) < self._workers

    def give(self, job: Job, attempt: int) -> None:
        """Begin a job; `attempt` comes back with what is heard of it."""
        worker = self._idle.pop() if self._idle else _Worker(self._threads)
        self.busy.append(worker)
        worker.give(job, attempt)

    def heard(self) -> Iterator[tuple[Job, int, Message]]:
        """Wait until something is heard of the jobs; with each its attempt."""
        ready = wait([worker.connection for worker in self.busy])
        for worker in [worker for worker in self.busy if worker.connection in ready]:
            message = worker.hear()
            if not isinstance(message, tuple):
                self.busy.remove(worker)
            if isinstance(message, Outcome):
                self._idle.append(worker)
            yield worker.job, worker.attempt, message

    def close(self) -> None:
        """End the processes, and wait until they have written what is done."""
        workers = [*self._idle, *self.busy]
        for worker in workers:
            worker.process.terminate()
        for worker in workers:
            worker.process.join()


Message = tuple[int, int] | Outcome | int
"""Progress as pairs done and pairs in all; what came of a job; the exit code of a process that is gone."""


class _Worker:
    """A process, and the job it is at."""

    job: Job
    attempt: int

    def __init__(self, threads: int) -> None:
        context = multiprocessing.get_context('spawn')
        self.connection, other = context.Pipe()
        self.process = context.Process(target=_serve, args=(other, threads), daemon=True)
        resource_tracker.ensure_running()  # otherwise started with the process, and unblocks the signals
        earlier = signal.pthread_sigmask(signal.SIG_BLOCK, _END_SIGNALS)
        try:  # the process has them blocked until it knows what to do with them
            self.process.start()
        finally:
            signal.pthread_sigmask(signal.SIG_SETMASK, earlier)
        other.close()

    def give(self, job: Job, attempt: int) -> None:
        """Have it process a job."""
        self.job, self.attempt = job, attempt
        with contextlib.suppress(OSError):  # it was killed meanwhile, which `hear` finds out
            self.connection.send(job)

    def hear(self) -> Message:
        """Wait for what comes next."""
        try:
            message: Message = self.connection.recv()
        except (EOFError, OSError):
            self.process.join()
            assert self.process.exitcode is not None
            return self.process.exitcode
        return message


def _serve(connection: Connection[Outcome | tuple[int, int], Job], threads: int) -> None:
    """In the process: one job after the other, until it is told to end, or its parent is gone."""
    threading.Thread(target=_end_with_parent, daemon=True).start()
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C goes to every process of a terminal; the parent decides
    signal.signal(signal.SIGTERM, _interrupt)
    configure()
    with contextlib.suppress(EOFError, KeyboardInterrupt):
        signal.pthread_sigmask(signal.SIG_UNBLOCK, _END_SIGNALS)
        while True:
            job = connection.recv()
            connection.send(outcome_of(job, threads, lambda done, total: connection.send((done, total))))


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    signal.signal(signal.SIGTERM, signal.SIG_IGN)  # once is enough: what is done is being written
    raise KeyboardInterrupt


def _end_with_parent() -> None:
    parent = multiprocessing.parent_process()
    assert parent is not None
    parent.join()
    os._exit(1)  # as after a kill: what is committed is kept
