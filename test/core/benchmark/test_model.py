import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import shifted_wall

from svdm_core import StereoMatcher, load_preset
from svdm_core.benchmark.contenders import why_not_modelled
from svdm_core.benchmark.model import PhaseTimes, TaskClock, WorkSpan, makespan, measure_model, shared_out
from svdm_core.benchmark.runs import BenchmarkPair

TASKS = st.lists(st.integers(0, 1000), max_size=40)  # whole, so that sums are exact
WORKERS = st.integers(1, 20)


def naive_makespan(tasks, workers):
    ends = [0] * workers
    for task in tasks:
        first = ends.index(min(ends))
        ends[first] += task
    return max(ends)


@settings(deadline=None, derandomize=True)
@given(TASKS, WORKERS)
def test_makespan_is_that_of_tasks_taken_in_order(tasks, workers):
    assert makespan(tasks, workers) == naive_makespan(tasks, workers)


@settings(deadline=None, derandomize=True)
@given(TASKS, WORKERS)
def test_makespan_lies_between_its_bounds(tasks, workers):
    longest, total, span = max(tasks, default=0), sum(tasks), makespan(tasks, workers)
    assert max(longest, total / workers) <= span <= total
    assert span <= total / workers + (1 - 1 / workers) * longest + 1e-9  # Graham 1969
    assert makespan(tasks, 1) == total and makespan(tasks, len(tasks) + 1) == longest


@settings(deadline=None, derandomize=True)
@given(TASKS, WORKERS, st.integers(0, 39), st.integers(0, 100))
def test_more_workers_never_take_longer_and_longer_tasks_never_less(tasks, workers, which, more):
    span = makespan(tasks, workers)
    assert makespan(tasks, workers + 1) <= span <= makespan([*tasks, more], workers)
    longer = [task + more * (number == which) for number, task in enumerate(tasks)]
    assert makespan(longer, workers) >= span


def test_a_frame_waits_after_each_phase():
    span = WorkSpan((PhaseTimes('a', 1, 2, (3, 3, 3)), PhaseTimes('b', 1, 2, (5,))), 4)
    assert span.frame(1) == 4 + 2 + 14
    assert span.frame(2) == 4 + 2 * 2 + 6 + 5 and span.frame(3) == span.frame(9) == 4 + 2 * 2 + 3 + 5


@pytest.mark.parametrize('total, tasks, shares', [
    (6, [1, 2], (2, 4)), (6, [1, -1, 2], (2, 0, 4)), (-1, [1, 2], (0, 0)), (3, [0, 0], (0, 0)), (3, [], ())])
def test_tasks_share_out_the_time_of_their_phase(total, tasks, shares):
    assert shared_out(total, tasks) == shares  # the noise of a clock is no negative time


@pytest.mark.parametrize('preset', ['fast', 'default'])
def test_task_by_task_the_disparities_are_the_same(preset):
    left, right = shifted_wall(70, 100, 6)
    clocks = []

    def clock():
        clocks.append(TaskClock())
        return clocks[-1]

    parameters = load_preset(preset)
    whole = StereoMatcher(parameters, 1).compute(left, right)
    split = StereoMatcher(parameters, 1, clock=clock).compute(left, right)
    assert whole.disparity.tobytes() == split.disparity.tobytes()
    assert len(clocks) == 1 and len(clocks[0].stages) == len(clocks[0].entries) == len(clocks[0].tasks)
    assert set(clocks[0].stages) <= set(whole.timings)


def test_rows_hold_a_measured_time_where_there_are_processors():
    left, right = shifted_wall(70, 100, 6)
    rounds = []
    model = measure_model(BenchmarkPair(left, right), load_preset('fast'), [1, 2, 1024], 3,
                          lambda: rounds.append(1))
    assert len(rounds) == 3 and model['serial_ms'] >= 0
    one, _, many = model['rows']
    assert one['measured_ms'] > 0 and many['measured_ms'] is many['difference_percent'] is None
    longest = sum(max(phase['tasks_ms']) + phase['shared_entry_ms'] for phase in model['phases'])
    assert many['ms'] == pytest.approx(model['serial_ms'] + longest)


def test_what_is_modelled():
    assert not any(why_not_modelled(load_preset(name)) for name in ('fast', 'default', 'accurate'))
    assert 'two tasks' in why_not_modelled(load_preset('paper'))
    assert 'median' in why_not_modelled(load_preset('default').replace(median_scope='all'))
