"""Threads share tasks: each is done once, with the scratch of one thread."""
from typing import NamedTuple

import numba
import numpy as np
import pytest

from svdm_core.kernels.tasks import do_tasks, share
from svdm_core.phases import Crew, Phase


class Ledger(NamedTuple):
    done: np.ndarray
    divisor: int


@numba.njit
def count(task, arena, ledger, step):
    arena[:] = task % 256
    ledger.done[task] += step * (task // ledger.divisor + 1)
    if arena.size > 0 and (arena != task % 256).any():  # another thread wrote there
        ledger.done[task] = -1


@numba.njit(nogil=True)
def count_all(counter, end, arenas, ledger, step):
    share(count, counter, end, arenas, (ledger, step))


@pytest.mark.parametrize('threads', [1, 2, 3, 7, 16])
@pytest.mark.parametrize('tasks', [0, 1, 5, 3000])
def test_each_task_is_done_once(threads, tasks):
    ledger = Ledger(np.zeros(tasks + 2, np.int64), 1 << 40)
    counter = np.array([1])
    count_all(counter, tasks, np.zeros((threads, 64), np.uint8), ledger, 3)
    assert (ledger.done[1:tasks] == 3).all() and ledger.done[0] == 0 and not ledger.done[max(tasks, 1):].any()


def test_a_crew_does_a_phase_or_a_part_of_it():
    crew, ledger = Crew(), Ledger(np.zeros(40, np.int64), 1 << 40)
    crew.gather(2)
    phase = Phase('any', 40, count_all, (ledger, 1), scratch=100)
    crew.work(phase, 10, 20)
    assert ledger.done.tolist() == [0] * 10 + [1] * 10 + [0] * 20
    crew.work(phase)
    assert ledger.done.tolist() == [1] * 10 + [2] * 10 + [1] * 20


def test_tasks_without_scratch():
    ledger = Ledger(np.zeros(500, np.int64), 1 << 40)
    do_tasks(count_all, 500, ledger, 2)
    assert (ledger.done == 2).all()


def test_what_fails_in_a_thread_is_told_and_the_next_call_works():
    with pytest.raises(RuntimeError, match='a kernel failed in one of its threads'):
        do_tasks(count_all, 100, Ledger(np.zeros(100, np.int64), 0), 1)
    ledger = Ledger(np.zeros(100, np.int64), 1)
    do_tasks(count_all, 100, ledger, 1)
    assert ledger.done.tolist() == list(range(1, 101))
