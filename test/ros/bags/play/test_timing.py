"""When the messages of a recording are due."""
import pytest

from svdm_ros.bags.play.timing import Lateness, Schedule

MS = 1_000_000


def play(schedule, *messages):
    """Due times in ms of (topic, time in ms)."""
    return [schedule.due(topic, time * MS) / MS for topic, time in messages]


@pytest.mark.parametrize('rate', [0.25, 1.0, 3.0])
def test_messages_are_due_by_their_distance_from_the_first(rate):
    schedule = Schedule(5000 * MS, 70 * MS, rate)
    assert play(schedule, ('a', 5000), ('b', 5010), ('a', 5900)) == pytest.approx(
        [70, 70 + 10 / rate, 70 + 900 / rate], abs=1e-5)


def test_no_rounding_adds_up():
    schedule = Schedule(0, 0, 3.0)
    assert [schedule.due('a', n * 33_333_333) for n in range(100_000)][-1] == round(99_999 * 33_333_333 / 3)


def test_a_pass_follows_as_if_the_recording_went_on():
    """Three images 100 ms apart: the next pass begins 100 ms after the third, whatever else is in the recording."""
    schedule = Schedule(0, 0)
    one_pass = [('image', 0), ('info', 0), ('image', 100), ('image', 200)]
    assert play(schedule, *one_pass) == [0, 0, 100, 200]
    for start in (300, 600):
        schedule.next_pass()
        assert play(schedule, *one_pass) == [start, start, start + 100, start + 200]


def test_passes_are_as_far_apart_at_another_rate():
    schedule = Schedule(0, 0, 2.0)
    play(schedule, ('image', 0), ('image', 100))
    schedule.next_pass()
    assert play(schedule, ('image', 0)) == [100]


@pytest.mark.parametrize('times', [(50,), (50, 50)])
def test_a_recording_of_one_moment_is_not_played_without_a_pause(times):
    schedule = Schedule(50 * MS, 0)
    play(schedule, *(('image', time) for time in times))
    schedule.next_pass()
    assert play(schedule, ('image', 50)) == [100]


def test_the_clock_runs_from_the_first_message_at_the_rate():
    schedule = Schedule(1000 * MS, 200 * MS, 2.0)
    play(schedule, ('image', 1000), ('image', 1100))
    assert [schedule.recording_time(now * MS) / MS for now in (100, 200, 210)] == [1000, 1000, 1020]
    schedule.next_pass()  # due 100 ms on
    assert [schedule.recording_time(now * MS) / MS for now in (290, 300, 350)] == [1000, 1000, 1100]


def test_lateness():
    lateness = Lateness()
    for late in (2 * MS, 4 * MS, 0):
        lateness.note(late)
    assert str(lateness) == '2.0 ms late on average, 4.0 at most'
    assert str(Lateness()) == '0.0 ms late on average, 0.0 at most'
