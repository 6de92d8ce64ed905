"""The node's publishers: one for each output, and which of them somebody listens to."""
from __future__ import annotations

import functools
import importlib
import threading
from collections.abc import Callable
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher

from svdm_core import NotEnoughMemoryError
from svdm_core.memory import in_gigabytes
from svdm_core.runtime.free_memory import RecentFreeMemory

from ..frames.matched_frame import MatchedFrame
from ..frames.messages import rclpy_types
from ..frames.outputs import OUTPUTS, Output
from .parameter_set import NodeParameters
from .quality_of_service import OVERRIDABLE, Entity, opening, output_qos

_COPIES = 3
"""Of a message while it is published: in C, and serialized in a buffer that grows by doubling."""


class OutputPublishers:
    """A publisher for each of OUTPUTS that there is; messages are made for those with subscribers only."""

    def __init__(
        self, node: Node, on_incompatible: Callable[[str, Entity, Any], None], on_listeners: Callable[[], None]
    ) -> None:
        """on_listeners: called when a subscriber comes or goes."""
        self._node = node
        self._on_incompatible, self._on_listeners = on_incompatible, on_listeners
        self._publishers: dict[Output, Publisher] = {}
        self._lock = threading.Lock()
        self._free = RecentFreeMemory()

    def adapt(self, parameters: NodeParameters) -> None:
        """Have publishers for the outputs that there are under these parameters.

        Raises ValueError where a topic cannot be opened.
        """
        for output in OUTPUTS:
            if output.when(parameters) and output not in self._publishers:
                self._publishers[output] = self._publisher(output)
            elif not output.when(parameters) and output in self._publishers:
                with self._lock:
                    self._node.destroy_publisher(self._publishers.pop(output))

    def _publisher(self, output: Output) -> Publisher:
        topic = self._node.resolve_topic_name(output.topic)
        events = PublisherEventCallbacks(
            incompatible_qos=functools.partial(self._on_incompatible, topic, 'publisher'),
            matched=lambda _: self._on_listeners())
        with opening(topic):
            return self._node.create_publisher(
                _message_class(output.message_type), output.topic, output_qos(), qos_overriding_options=OVERRIDABLE,
                event_callbacks=events)

    def have_listeners(self) -> bool:
        return any(map(self._is_wanted, OUTPUTS))

    def publish(self, frame: MatchedFrame) -> None:
        """From the worker's thread; `adapt` is called from another.

        Raises NotEnoughMemoryError where a message does not fit any more: those before it are out.
        """
        for output in OUTPUTS:
            if output.when(frame.parameters) and self._is_wanted(output):
                message = output.make(frame, rclpy_types())
                _check_room(output.topic, message, self._free())
                with self._lock:
                    if output in self._publishers:
                        self._publishers[output].publish(message)

    def _is_wanted(self, output: Output) -> bool:
        with self._lock:
            return output in self._publishers and self._publishers[output].get_subscription_count() > 0


def _check_room(topic: str, message: Any, free: int | None) -> None:
    """Raise NotEnoughMemoryError before DDS runs out of memory, which it does not always survive."""
    size = len(getattr(getattr(message, 'image', message), 'data', b''))
    if free is not None and _COPIES * size > free:
        raise NotEnoughMemoryError(f'{topic} needs {in_gigabytes(_COPIES * size)} to be published, and '
                                   f'{in_gigabytes(free)} are free: set downscale, roi or a larger point_stride')


def _message_class(name: str) -> type:
    """The class of 'sensor_msgs/msg/Image'."""
    package, _, kind = name.split('/')
    found: type = getattr(importlib.import_module(f'{package}.msg'), kind)
    return found
