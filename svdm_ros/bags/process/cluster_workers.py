"""Many recordings on a Dask cluster: one at a time a worker, each bag for itself. Needs dask and distributed."""
from __future__ import annotations

import contextlib
from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from typing import Any

import distributed

from svdm_core.runtime import configure

from .outcome import Outcome, outcome_of
from .processing import Job, Tell

_TOPIC = 'svdm_progress'
_CONNECT_S = 20


@contextlib.contextmanager
def cluster(scheduler: str) -> Iterator[distributed.Client]:
    """The Dask cluster at `scheduler`; the certificates for tls:// are those of the configuration of Dask.

    Raises ValueError where no scheduler answers.
    """
    security = distributed.Security()
    try:
        has_certificate = bool(security.get_connection_args('client').get('ssl_context'))
        if scheduler.startswith('tls:') and not has_certificate:
            raise ValueError('tls needs certificates: set DASK_DISTRIBUTED__COMM__TLS__CA_FILE, __CLIENT__CERT and '
                             '__CLIENT__KEY, see docs/bags.md')
        client = distributed.Client(scheduler, timeout=_CONNECT_S, set_as_default=False, security=security)
    except (OSError, ValueError) as error:
        raise ValueError(f'--scheduler {scheduler}: no Dask scheduler answers there '
                         f'({" ".join(str(error).split())})') from None
    with client:
        yield client


def process_all(
    client: distributed.Client, jobs: Sequence[Job], at_a_time: int | None, teller: Callable[[str], Tell]
) -> Generator[Outcome, None, None]:
    """Process every job and give what came of it as soon as it is known.

    at_a_time: at most so many, never more than there are workers. `teller(name)` makes what is told of the progress.
    """
    workers = list(client.nthreads())
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
    """In the worker: the matcher has as many threads as the worker."""
    configure()
    worker = distributed.get_worker()
    return outcome_of(job, worker.state.nthreads, lambda done, total: worker.log_event(
        _TOPIC, [str(job.input), done, total]))
