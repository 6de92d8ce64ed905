"""One of many recordings, processed in a process of its own: what is told meanwhile, and what came of it."""
from __future__ import annotations

import dataclasses
import time

from .processing import Job, Tell, process

_TELL_EVERY_S = 0.5


@dataclasses.dataclass(frozen=True, slots=True)
class Outcome:
    """Of one recording: the lines of its summary, empty where nothing came out, and what went wrong if anything did."""

    name: str
    lines: list[str]
    problem: str
    exit_code: int


def outcome_of(job: Job, threads: int, tell: Tell) -> Outcome:
    """Process a recording; the matcher has so many threads unless the parameters say otherwise."""
    if not job.parameters.num_threads:
        job = dataclasses.replace(job, parameters=dataclasses.replace(job.parameters, num_threads=threads))
    try:
        summary = process(job, _now_and_then(tell))
    except (ValueError, OSError) as error:
        return Outcome(str(job.input), [], str(error), 2)
    return Outcome(str(job.input), list(summary.lines()), summary.problem, summary.exit_code)


def _now_and_then(tell: Tell) -> Tell:
    """Tells twice a second, and of the end."""
    told = 0.0

    def sometimes(done: int, total: int) -> None:
        nonlocal told
        now = time.monotonic()
        if now - told >= _TELL_EVERY_S or done == total:
            told = now
            tell(done, total)
    return sometimes
