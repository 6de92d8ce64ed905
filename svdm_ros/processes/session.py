"""What listens to disparity_node, for demo and benchmark: receives disparity, reads the counts, sets parameters."""
from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from numpy.typing import NDArray
from rclpy.executors import SingleThreadedExecutor
from rclpy.parameter import Parameter
from rclpy.parameter_client import AsyncParameterClient
from rclpy.qos import QoSProfile
from stereo_msgs.msg import DisparityImage

from ..node.diagnostics import READY, STATE
from .children import RunError

NODE_NAME = '/disparity_node'
STEP = 0.05  # s between two looks at what is being waited for
QUIET = 5.0  # s; the node publishes its counts once a second, and may have a frame in work
SETTLE_TIMEOUT = 60.0  # s


@dataclasses.dataclass(frozen=True, slots=True)
class Frame:
    """A disparity image received. stamp, received: ns, wall clock. disparity: float32 (H, W), px, NaN invalid."""

    stamp: int
    received: int
    disparity: NDArray[np.float32]

    @property
    def latency(self) -> float:
        """ms from the sending of the pair to the receipt of its disparity."""
        return (self.received - self.stamp) / 1e6


class Session:
    """Collects the node's `counts`, and `frames` from `listen` on, while one of its waiting methods runs.

    rclpy must be up.
    `check` is called all the while and raises RunError when there is no point in waiting on.
    """

    def __init__(self, check: Callable[[], None]) -> None:
        self.frames: list[Frame] = []
        self.counts: dict[str, str] = {}
        self._check = check
        self._executor = SingleThreadedExecutor()
        self._node = rclpy.create_node('demo_session')
        self._executor.add_node(self._node)
        self._parameters = AsyncParameterClient(self._node, NODE_NAME)
        self.subscribe(DiagnosticArray, '/diagnostics', self._take_counts)

    def subscribe(self, message_type: type, topic: str, take: Callable[[Any], None]) -> None:
        """From now on `take` is called with each message of a topic, while one of the waiting methods runs."""
        self._node.create_subscription(message_type, topic, take, QoSProfile(depth=10))

    def close(self) -> None:
        """Listen no more."""
        self._executor.shutdown()
        self._node.destroy_node()

    def wait_for(self, done: Callable[[], bool], timeout: float, complaint: str) -> None:
        """Receive until `done()`; RunError with `complaint` after `timeout` s."""
        end = time.monotonic() + timeout
        while not done():
            self._check()
            if time.monotonic() > end:
                raise RunError(f'{complaint} for {timeout:.0f} s')
            self._executor.spin_once(timeout_sec=STEP)

    def wait_for_node(self, timeout: float) -> None:
        """Until the node's parameter services are there."""
        self.wait_for(self._parameters.services_are_ready, timeout, f'{NODE_NAME} has no parameter services')

    def listen(self, timeout: float) -> None:
        """Wait until there is a camera, then listen to the disparity: the node looks for images only from then on."""
        self.wait_for(lambda: all(self._node.count_publishers(f'{side}/image_rect') for side in ('left', 'right')),
                      timeout, 'no camera has come')
        self.subscribe(DisparityImage, 'disparity', self._take_disparity)

    def wait_until_ready(self, timeout: float, complaint: str) -> None:
        """Until the node tells in its diagnostics that its kernels are compiled; RunError as `wait_for`."""
        self.wait_for(lambda: self.counts.get(STATE) == READY, timeout, complaint)

    def collect(self, count: int, after: int, timeout: float, progress: Callable[[int], None]) -> list[Frame]:
        """Receive until `count` frames have a stamp later than `after` (ns); `timeout` s is for each frame."""
        def taken() -> list[Frame]:
            return [frame for frame in self.frames if frame.stamp > after]

        while (so_far := len(taken())) < count:
            self.wait_for(lambda: len(taken()) > so_far, timeout, 'no disparity image arrived')
            progress(len(taken()))
        return taken()[:count]

    def set_parameters(self, values: Mapping[str, Any], timeout: float = 10.0) -> int:
        """Set all `values` at once; returns the ns at which the node said yes. RunError with its reason if not."""
        future = self._parameters.set_parameters_atomically(
            [Parameter(name, value=value) for name, value in values.items()])
        self.wait_for(future.done, timeout, 'no answer to the change of parameters')
        result = future.result().result
        if not result.successful:
            raise RunError(f'{NODE_NAME} refused the parameters: {result.reason}')
        return time.time_ns()

    def count(self, name: str) -> int:
        """One of the node's totals, 0 where it has not counted any."""
        return int(self.counts.get(name, 0))

    def wait_until_settled(self, sent: int) -> None:
        """Until all `sent` pairs are accounted for, or nothing has changed for QUIET s."""
        last_change, last = time.monotonic(), (-1, -1)

        def settled() -> bool:
            nonlocal last_change, last
            now = (len(self.frames), self.superseded())
            if now != last:
                last_change, last = time.monotonic(), now
            return sum(now) >= sent or time.monotonic() - last_change > QUIET

        self.wait_for(settled, SETTLE_TIMEOUT, 'the node went on counting without an image being sent')

    def superseded(self) -> int:
        """Pairs the node dropped for a newer one, or because it was still compiling."""
        return self.count('dropped: superseded') + self.count('dropped: before warm-up')

    def _take_disparity(self, message: DisparityImage) -> None:
        received = time.time_ns()
        stamp = message.header.stamp.sec * 10**9 + message.header.stamp.nanosec
        image = message.image
        disparity = np.frombuffer(image.data, np.float32).reshape(image.height, image.width)
        valid = disparity >= message.min_disparity  # as stereo_msgs defines it
        self.frames.append(Frame(stamp, received, np.where(valid, disparity, np.float32(np.nan))))

    def _take_counts(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name == NODE_NAME:
                self.counts = {value.key: value.value for value in status.values}
