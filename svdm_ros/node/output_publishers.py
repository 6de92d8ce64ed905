"""The node's publishers: one for each output, and which of them somebody listens to."""
from __future__ import annotations

import functools
import importlib
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from typing import Any

from rclpy.event_handler import PublisherEventCallbacks
from rclpy.node import Node
from rclpy.publisher import Publisher

from ..frames.matched_frame import MatchedFrame
from ..frames.messages import rclpy_types
from ..frames.outputs import OUTPUTS, Output
from .quality_of_service import OVERRIDABLE, Entity, output_qos


class OutputPublishers:
    """Makes a publisher for each of OUTPUTS; messages are made for those with subscribers only."""

    def __init__(
        self, node: Node, opening: Callable[[str], AbstractContextManager[None]],
        on_incompatible: Callable[[str, Entity, Any], None], on_listeners: Callable[[], None],
    ) -> None:
        """opening: around the making of a publisher of a topic. on_listeners: called when a subscriber comes or goes.

        Raises ValueError where a topic cannot be opened.
        """
        self._publishers: list[tuple[Output, Publisher]] = []
        for output in OUTPUTS:
            topic = node.resolve_topic_name(output.topic)
            events = PublisherEventCallbacks(
                incompatible_qos=functools.partial(on_incompatible, topic, 'publisher'),
                matched=lambda _: on_listeners())
            with opening(topic):
                publisher = node.create_publisher(
                    _message_class(output.message_type), output.topic, output_qos(), qos_overriding_options=OVERRIDABLE,
                    event_callbacks=events)
            self._publishers.append((output, publisher))

    def wanted(self) -> Iterator[tuple[Output, Publisher]]:
        """The outputs that somebody listens to."""
        return ((output, publisher) for output, publisher in self._publishers if publisher.get_subscription_count())

    def have_listeners(self) -> bool:
        return any(True for _ in self.wanted())

    def publish(self, frame: MatchedFrame) -> None:
        for output, publisher in self.wanted():
            publisher.publish(output.make(frame, rclpy_types()))


def _message_class(name: str) -> type:
    """The class of 'sensor_msgs/msg/Image'."""
    package, _, kind = name.split('/')
    found: type = getattr(importlib.import_module(f'{package}.msg'), kind)
    return found
