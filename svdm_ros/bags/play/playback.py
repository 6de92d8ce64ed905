"""Publishes a recording into DDS at the times it was recorded."""
from __future__ import annotations

import argparse
import contextlib
import itertools
import signal
import sys
import threading
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence

import rclpy
from builtin_interfaces.msg import Time
from rclpy.duration import Duration
from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import QoSProfile, ReliabilityPolicy
from rclpy.signals import SignalHandlerOptions
from rclpy.utilities import try_shutdown
from rosgraph_msgs.msg import Clock

from svdm_core.shown import cut, line

from ...processes.dds_profile import image_profile
from ..reading.recording import RecordedMessage, Recording, RecordingError, Topic, open_recording, start_option
from .publishers import create_publishers
from .timing import Lateness, Schedule

CLOCK = '/clock'
_SETTLED = 1.0
"""s without a further subscriber, after which all that listen are taken to be there."""
_POLL = 0.02
_LONG_WAIT = 10.0
"""s without a message, from which on it is told."""
_LINGER = 0.2
"""s; for the last messages to be taken, best effort ones too."""
_ACKNOWLEDGED = 4.0
"""s to wait for reliable subscribers at the end; Fast DDS asks them every 3 s what they have received."""


def play(options: argparse.Namespace, ros_arguments: list[str]) -> int:
    """Play, and say what was played; the exit code as `play_bag.main` has it."""
    try:
        with open_recording(options.bag) as recording:
            for note in (*recording.missing, *recording.notes):
                print(f'play_bag: {note}', file=sys.stderr)
            part = _part(recording, options.start, options.duration)
            topics = chosen_topics(recording.topics, options.topics, with_clock=options.clock is None)
            with _node(ros_arguments) as node:
                return _play(recording, part, topics, node, options)
    except (ValueError, RuntimeError) as error:  # rclpy's, of remappings, are one or the other
        print(f'play_bag: {line(error)}', file=sys.stderr)
        return 2


def _play(
    recording: Recording, part: tuple[int, int | None], topics: Sequence[Topic], node: Node,
    options: argparse.Namespace,
) -> int:
    publishers, left_out = create_publishers(node, topics, recording.typestore)
    for reason in left_out:
        print(f'play_bag: left out: {line(reason)}', file=sys.stderr)
    if not publishers:
        raise ValueError(f'{recording.path}: nothing of it can be played')
    clock = ClockPublisher(node, options.clock) if options.clock else None
    stop = _stop_on_signals()
    player = Player(publishers, clock, options.rate, stop, recording.start_ns)
    if options.wait_for_subscribers:
        _wait_for_subscribers(publishers, stop)
    code = 1 if recording.missing else 0
    try:
        for _ in itertools.count() if options.loop == 0 else range(options.loop):
            player.play_pass(recording.messages(set(publishers), *part))
            if stop.is_set():
                break
            if not player.lateness.count:
                raise ValueError(f'{recording.path}: no message of these topics in this part of it'
                                 f'{recording.where(set(publishers))}')
    except RecordingError as error:
        if not player.lateness.count:
            raise
        print(f'play_bag: {line(error)}', file=sys.stderr)
        code = 1
    if not stop.is_set():
        _let_arrive(publishers.values())
    print(f'{player}{", interrupted" if stop.is_set() else ""}')
    return code


def _stop_on_signals() -> threading.Event:
    """Set by SIGINT and SIGTERM from now on; an exception could come between publishing and counting."""
    stop = threading.Event()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    return stop


class Player:
    """Publishes messages when they are due, with the clock of the recording beside them, until `stop` is set.

    begin_ns: recording time of its first message, from which --start counts.
    """

    def __init__(
        self, publishers: Mapping[str, Publisher], clock: ClockPublisher | None, rate: float, stop: threading.Event,
        begin_ns: int,
    ) -> None:
        self.lateness = Lateness()
        self._begin = begin_ns
        self._publishers, self._clock, self._rate, self._stop = publishers, clock, rate, stop
        self._schedule: Schedule | None = None
        self._passes = 0

    def play_pass(self, messages: Iterable[RecordedMessage]) -> None:
        """Publish `messages`, which are in order of time, once; a further pass follows the one before."""
        if self._schedule is not None:
            self._schedule.next_pass()
        for message in messages:
            if self._schedule is None:
                self._schedule = Schedule(message.time_ns, time.monotonic_ns(), self._rate)
            due = self._schedule.due(message.topic, message.time_ns)
            self._announce(due, message)
            self._wait_until(due, self._schedule)
            if self._stop.is_set():
                return
            self.lateness.note(time.monotonic_ns() - due)
            self._publishers[message.topic].publish(message.data)
        self._passes += 1

    def _announce(self, due: int, message: RecordedMessage) -> None:
        """Tell of a wait that would be taken for a standstill: a clock that was wrong at first, or a pause."""
        wait = (due - time.monotonic_ns()) / 1e9
        if wait >= _LONG_WAIT:
            into = message.time_ns - self._begin
            print(f'nothing for {wait:.0f} s: the next message, on {message.topic}, was recorded {into / 1e9:.3f} s '
                  f'after the first; --start {start_option(into)} begins with it', flush=True)

    def _wait_until(self, due: int, schedule: Schedule) -> None:
        """Until the monotonic time `due` (ns), with the clock ticking meanwhile."""
        while not self._stop.is_set():
            now = time.monotonic_ns()
            wake = due
            if self._clock is not None:
                wake = min(due, self._clock.tick(now, schedule))
            if now >= due:
                return
            self._stop.wait((wake - now) / 1e9)

    def __str__(self) -> str:
        """What has been played so far, in one line."""
        passes = 'pass' if self._passes == 1 else 'passes'
        return f'played {self.lateness.count} messages, {self._passes} whole {passes}; {self.lateness}'


class ClockPublisher:
    """Publishes the time of the recording on /clock, `frequency` times a second."""

    def __init__(self, node: Node, frequency: float) -> None:
        qos = QoSProfile(depth=1, reliability=ReliabilityPolicy.BEST_EFFORT)  # as its subscribers, rclpy's and rclcpp's
        self._publisher = node.create_publisher(Clock, CLOCK, qos)
        self._period = round(1e9 / frequency)
        self._next = 0

    def tick(self, now: int, schedule: Schedule) -> int:
        """Publish where it is time to; the monotonic time (ns) of the next tick."""
        if now >= self._next:
            second, nanosecond = divmod(schedule.recording_time(now), 10**9)
            self._publisher.publish(Clock(clock=Time(sec=second, nanosec=nanosecond)))
            self._next = max(self._next + self._period, now + self._period // 2)
        return self._next


def chosen_topics(topics: Mapping[str, Topic], wanted: Sequence[str], with_clock: bool) -> list[Topic]:
    """The topics `wanted`, with or without their leading '/', all where none is named; /clock only `with_clock`.

    Raises ValueError for one that is not in the recording.
    """
    names = {name.removeprefix('/'): name for name in topics}
    for name in wanted:
        if name.removeprefix('/') not in names:
            raise ValueError(f'there is no topic {cut(name)}; there are {", ".join(map(cut, topics))}')
    chosen = [names[name.removeprefix('/')] for name in wanted] or list(topics)
    return [topics[name] for name in dict.fromkeys(chosen) if with_clock or name != CLOCK]


def _part(recording: Recording, start: float, duration: float | None) -> tuple[int, int | None]:
    """Recording times (ns) from which and before which to play."""
    if not any(topic.count for topic in recording.topics.values()):
        raise ValueError(f'{recording.path}: no message in it')
    first = recording.start_ns + round(start * 1e9)
    if first >= recording.end_ns:
        length = (recording.end_ns - recording.start_ns) / 1e9
        raise ValueError(f'--start {start:g} is not allowed: the recording is {length:.3f} s long')
    return first, None if duration is None else first + round(duration * 1e9)


def _wait_for_subscribers(publishers: Mapping[str, Publisher], stop: threading.Event) -> None:
    print('waiting for a subscriber', flush=True)
    found, since = 0, time.monotonic()
    while not stop.wait(_POLL):
        now, matched = time.monotonic(), sum(one.get_subscription_count() for one in publishers.values())
        if matched != found:
            found, since = matched, now
        if found and now - since >= _SETTLED:
            return


def _let_arrive(publishers: Iterable[Publisher]) -> None:
    """What is taken down right after it has sent takes its last messages with it."""
    end = time.monotonic() + _ACKNOWLEDGED
    for publisher in publishers:
        publisher.wait_for_all_acked(Duration(seconds=max(0.0, end - time.monotonic())))
    time.sleep(_LINGER)


@contextlib.contextmanager
def _node(ros_arguments: list[str]) -> Iterator[Node]:
    """A node that nothing spins, so it offers no services."""
    try:
        with image_profile():
            rclpy.init(args=ros_arguments, signal_handler_options=SignalHandlerOptions.NO)
            node = rclpy.create_node('play_bag', start_parameter_services=False)
        yield node
        node.destroy_node()
    finally:
        try_shutdown()
