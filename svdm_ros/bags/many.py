"""Many recordings on Dask: one at a time a worker, each bag for itself. Needs dask and distributed."""
from __future__ import annotations

import contextlib
import dataclasses
import os
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import distributed

from svdm_core.runtime import configure

from .process import Job, Tell, process

_TOPIC = 'svdm_progress'
_TELL_EVERY_S = 0.5
_CONNECT_S = 20


@dataclasses.dataclass(frozen=True, slots=True)
class Outcome:
    """Of one recording: the lines of its summary, empty where nothing came out, and what went wrong if anything did."""

    name: str
    lines: list[str]
    problem: str
    exit_code: int


@contextlib.contextmanager
def cluster(scheduler: str | None, jobs: int, recordings: int) -> Iterator[distributed.Client]:
    """The cluster at `scheduler`, else one of our own: processes on this machine that listen on loopback only.

    Our own has `jobs` workers, or fewer where there are fewer recordings, and divides the processors among them.
    Raises ValueError where no scheduler answers.
    """
    if scheduler:
        try:
            client = distributed.Client(scheduler, timeout=_CONNECT_S, set_as_default=False)
        except (OSError, ValueError) as error:
            raise ValueError(f'--scheduler {scheduler}: no Dask scheduler answers there '
                             f'({" ".join(str(error).split())})') from None
        with client:
            yield client
        return
    workers = min(jobs, recordings)
    threads = max(len(os.sched_getaffinity(0)) // workers, 1)
    with (distributed.LocalCluster(  # type: ignore[no-untyped-call]
            n_workers=workers, threads_per_worker=threads, host='127.0.0.1', dashboard_address=None, memory_limit=0,
            silence_logs=50) as local,
          distributed.Client(local, set_as_default=False) as client):
        yield client


def process_all(
    client: distributed.Client, jobs: Sequence[Job], at_a_time: int | None, teller: Callable[[str], Tell]
) -> Iterator[Outcome]:
    """Process every job and give what came of it as soon as it is known.

    at_a_time: at most so many, never more than there are workers. `teller(name)` makes what is told of the progress.
    """
    workers = list(client.nthreads())  # type: ignore[no-untyped-call]
    if not workers:
        raise ValueError('the Dask cluster has no workers: start some with `dask worker`')
    free = deque(workers[:at_a_time])
    waiting = deque(jobs)
    running: dict[Any, tuple[Job, str]] = {}
    tellers = {str(job.input): teller(job.input.name) for job in jobs}

    def hear(event: tuple[float, Any]) -> None:
        name, done, total = event[1]
        if name in tellers:
            tellers[name](done, total)

    client.subscribe_topic(_TOPIC, hear)
    results = distributed.as_completed(loop=client.loop)
    try:
        while waiting or running:
            while waiting and free:
                job, worker = waiting.popleft(), free.popleft()
                # Where the worker is gone meanwhile, any other will do; a run that was killed is gone on with.
                future = client.submit(_process_here, job, workers=[worker], allow_other_workers=True, pure=False)
                running[future] = job, worker
                results.add(future)
            future = next(results)
            job, worker = running.pop(future)
            free.append(worker)
            yield _outcome(job, future)
    finally:
        client.cancel(list(running))
        client.unsubscribe_topic(_TOPIC)


def _outcome(job: Job, future: Any) -> Outcome:
    error = future.exception()
    if error is None:
        outcome: Outcome = future.result()
        return outcome
    # A worker without svdm_ros, or one that was killed again and again.
    return Outcome(str(job.input), [], f'{job.input}: {type(error).__name__}: {" ".join(str(error).split())}', 2)


def _process_here(job: Job) -> Outcome:
    """In the worker: the matcher has as many threads as the worker, unless the parameters say otherwise."""
    configure()
    worker = distributed.get_worker()
    if not job.parameters.num_threads:
        parameters = dataclasses.replace(job.parameters, num_threads=worker.state.nthreads)
        job = dataclasses.replace(job, parameters=parameters)
    try:
        summary = process(job, _Reporter(worker, str(job.input)))
    except (ValueError, OSError) as error:
        return Outcome(str(job.input), [], str(error), 2)
    return Outcome(str(job.input), list(summary.lines()), summary.problem, summary.exit_code)


class _Reporter:
    """Tells the client of the progress, now and then."""

    def __init__(self, worker: distributed.Worker, name: str) -> None:
        self._worker = worker
        self._name = name
        self._told = 0.0

    def __call__(self, done: int, total: int) -> None:
        now = time.monotonic()
        if now - self._told >= _TELL_EVERY_S or done == total:
            self._told = now
            self._worker.log_event(_TOPIC, [self._name, done, total])
