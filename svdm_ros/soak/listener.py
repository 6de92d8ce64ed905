"""What the soak hears of the node: answers, compared with those made offline, and outcomes of requests."""
from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from rclpy.parameter import Parameter, parameter_value_to_python
from stereo_msgs.msg import DisparityImage

from ..node.parameter_set import node_parameter_table
from ..processes.session import Session
from .good_pairs import differing, may_have_other_calibration, parse_frame_id
from .tally import Tally

START_TIMEOUT = 60.0  # s
NAMES = [info.name for info in node_parameter_table()]
"""Of all parameters."""
_DROPPED = 'dropped: '


class Listener(Session):
    """Compares what it receives with `expected`, where that is set, and counts."""

    def __init__(self, check: Callable[[], None], tally: Tally, hostile: bool) -> None:
        """hostile: whether calibrations of any content are sent as well."""
        super().__init__(check)
        self._tally, self._hostile = tally, hostile
        self._start = time.monotonic()
        self._expected: list[DisparityImage] | None = None
        self._since = 0
        self.latencies_count = False

    @property
    def seconds(self) -> float:
        """Since the start."""
        return time.monotonic() - self._start

    def begin(self) -> None:
        """Count from now on."""
        self._tally.minutes.clear()
        self._tally.samples.clear()
        self._start = time.monotonic()

    def expect(self, answers: list[DisparityImage] | None) -> None:
        """From now on the answer of a pair that is sent is one of these; None: it may be any."""
        self._expected, self._since = answers, time.time_ns()

    def spend(self, seconds: float) -> None:
        """Receive for so long."""
        end = time.monotonic() + seconds
        self.wait_for(lambda: time.monotonic() >= end, seconds + 60, 'the clock stood still')

    def drain(self, sent: int, seconds: float) -> None:
        """Receive until the node has counted all pairs `sent` as published, or for so long."""
        end = time.monotonic() + seconds
        self.wait_for(lambda: self.count('published') >= sent or time.monotonic() >= end, seconds + 60,
                      'the clock stood still')

    def _take_disparity(self, message: DisparityImage) -> None:
        known = parse_frame_id(message.header.frame_id)
        if known is None:
            return
        number, pair, sent = known
        minute = self._tally.minute(self.seconds)
        minute.answered += 1
        if self.latencies_count and sent >= self._since:
            minute.latencies.append((time.time_ns() - sent) / 1e6)
        if self._expected is not None and sent >= self._since:
            minute.compared += 1
            wrong = differing(message, self._expected[pair])
            if self._hostile and may_have_other_calibration(sent, wrong):
                minute.other_calibration += 1
            elif wrong:
                minute.wrong += 1
                self._tally.fault('another answer than offline', f'{", ".join(wrong)} of pair {number}')

    def dropped(self) -> dict[str, int]:
        """Pairs that the node dropped, by reason."""
        named = {name.removeprefix(_DROPPED): int(value) for name, value in self.counts.items()
                 if name.startswith(_DROPPED)}
        return {reason: count for reason, count in named.items() if count}

    def ask(self, changes: dict[str, Any]) -> tuple[bool, str]:
        """Request all changes together; whether they were taken, and the reason where not."""
        parameters = [Parameter(name, value=value) for name, value in changes.items()]
        future = self._parameters.set_parameters_atomically(parameters)
        self.wait_for(future.done, START_TIMEOUT, 'no answer to a request')
        result = future.result().result
        return result.successful, result.reason

    def values(self) -> dict[str, Any]:
        """All parameters as the node has them."""
        future = self._parameters.get_parameters(NAMES)
        self.wait_for(future.done, START_TIMEOUT, 'no answer to a request')
        return dict(zip(NAMES, map(parameter_value_to_python, future.result().values), strict=True))
