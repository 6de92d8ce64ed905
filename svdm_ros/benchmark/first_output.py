"""How long somebody waits who begins to listen to an idle node: a participant of its own, as a new process has it."""
from __future__ import annotations

import time
from collections.abc import Callable

import rclpy
from rclpy.context import Context
from rclpy.executors import SingleThreadedExecutor
from rclpy.signals import SignalHandlerOptions
from stereo_msgs.msg import DisparityImage

from ..processes.children import RunError

TIMES = 3
IDLE = 1.0  # s; the node takes no images any more
TIMEOUT = 10.0  # s


def first_outputs(check: Callable[[], None]) -> list[float]:
    """Seconds from the making of a participant to its first disparity, TIMES times; cameras must be sending.

    Raises RunError where none arrives, and whatever `check`, called often, raises.
    """
    seconds = []
    for _ in range(TIMES):
        time.sleep(IDLE)
        seconds.append(_first_output(check))
    return seconds


def _first_output(check: Callable[[], None]) -> float:
    context, received, start = Context(), [], time.monotonic()
    rclpy.init(context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node('first_output', context=context)
        executor = SingleThreadedExecutor(context=context)
        executor.add_node(node)
        node.create_subscription(DisparityImage, 'disparity', lambda _: received.append(time.monotonic()), 1)
        while not received:
            check()
            if time.monotonic() - start > TIMEOUT:
                raise RunError(f'no disparity image arrived within {TIMEOUT:g} s of a subscription')
            executor.spin_once(timeout_sec=0.01)
        executor.shutdown()
        node.destroy_node()
    finally:
        context.try_shutdown()
    return received[0] - start
