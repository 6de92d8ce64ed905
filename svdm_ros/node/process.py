"""Runs the node: rclpy up and down around it, what may be raised on the way, and the exit code."""
from __future__ import annotations

import contextlib
import os
import sys
import traceback

import rclpy
from rclpy.exceptions import ParameterException
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.logging import get_logger
from rclpy.utilities import ok, remove_ros_args, try_shutdown

from svdm_core.memory import is_out_of_memory
from svdm_core.runtime import configure
from svdm_core.shown import line

from ..processes.dds_profile import image_profile
from .disparity_node import DisparityNode
from .end_signals import EndSignals
from .usage import answer, check_ros_arguments

_WRONG_SETTINGS = (ValueError, RuntimeError, ParameterException)
"""What a bad parameter, remapping or QoS override ends in while the node is made; rclpy has no common class for it."""

_MOST_FAILURES = 1000
"""In a row, until the node gives up: each message that cannot be taken is one."""

_BAD_REQUEST = (ValueError, TypeError, AssertionError)
"""What rclpy raises of its own on a request or message that is malformed."""


def run(signals: EndSignals, arguments: list[str] | None = None) -> int:
    """Run the node; returns the exit code: 0 after SIGINT, SIGTERM or --help, 2 for a setting that is wrong."""
    try:
        check_ros_arguments(sys.argv if arguments is None else arguments)  # rcl opens them with the first call
        answered = answer(remove_ros_args(arguments)[1:])
        if answered is not None:
            return answered
        configure()
        rclpy.init(args=arguments)
    except (RuntimeError, ValueError) as error:
        return _refuse_to_start(error)
    signals.end_in_order()
    return _run_node(signals)


def _run_node(signals: EndSignals) -> int:
    code, node, idle = 0, None, True
    try:
        with image_profile():
            node = DisparityNode()
        _spin(node)
    except Exception as error:
        # A signal shuts the context down under whatever runs, which then raises; that is no error.
        if ok() and not signals.received:
            if node is not None or not isinstance(error, _WRONG_SETTINGS):
                raise
            code = _refuse_to_start(error)
    finally:
        signals.ignore()
        if node is not None:
            idle = node.close()
        try_shutdown()
    if not idle:
        # A thread inside a kernel or the compiler crashes when the interpreter is taken down under it.
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code


def _spin(node: DisparityNode) -> None:
    """Until the context is shut down. Neither a malformed request or message nor a callback that fails ends the node.
    """
    executor = SingleThreadedExecutor()
    executor.add_node(node)
    failures = 0
    while executor.context.ok():
        try:
            executor.spin_once()
            failures = 0
        except ExternalShutdownException:
            return
        except Exception as error:
            if not executor.context.ok():
                return
            failures += 1
            if failures > _MOST_FAILURES:
                raise
            with contextlib.suppress(MemoryError):  # of the report itself
                _report(node, error)


def _report(node: DisparityNode, error: Exception) -> None:
    """Say what the error has cost; raises one that is none of a callback, a request or a message."""
    if is_out_of_memory(error):
        node.failures.no_memory('message dropped', error)
    elif _is_ours(error):
        node.failures.defect('callback cut short', error)
    elif isinstance(error, _BAD_REQUEST):
        node.get_logger().error(f'a request was dropped: {line(error)}')
    elif isinstance(error, RuntimeError):  # its text does not tell that an image did not fit into the memory
        node.failures.untaken(error)
    else:
        raise error


def _is_ours(error: Exception) -> bool:
    """Whether rclpy was in a callback of this project; the outermost frame is `_spin`, which called rclpy."""
    frames = [frame for frame, _ in traceback.walk_tb(error.__traceback__)][1:]
    return any(frame.f_globals.get('__name__', '').startswith(('svdm_ros.', 'svdm_core.')) for frame in frames)


def _refuse_to_start(error: Exception) -> int:
    get_logger('disparity_node').fatal(f'not started: {line(error)}')
    return 2
