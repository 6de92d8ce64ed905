"""Messages without ROS: the classes that are written, and camera_info of a recording by time."""
from __future__ import annotations

import collections
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from ...frames.messages import MessageTypes

ROS2 = get_typestore(Stores.ROS2_JAZZY)
"""The types of all that is written."""

_KEPT = 1000


def _bytes_of(values: NDArray[Any]) -> NDArray[np.uint8]:
    return values.reshape(-1).view(np.uint8)


def _room(shape: tuple[int, ...]) -> tuple[NDArray[np.uint8], NDArray[np.float32]]:
    values = np.empty(shape, np.float32)
    return _bytes_of(values), values


TYPES = MessageTypes(
    ROS2.types['stereo_msgs/msg/DisparityImage'],
    ROS2.types['sensor_msgs/msg/Image'],
    ROS2.types['sensor_msgs/msg/CompressedImage'],
    ROS2.types['sensor_msgs/msg/PointCloud2'],
    ROS2.types['sensor_msgs/msg/PointField'],
    ROS2.types['sensor_msgs/msg/CameraInfo'],
    ROS2.types['sensor_msgs/msg/RegionOfInterest'],
    _bytes_of,
    _room,
    lambda numbers: np.array(numbers, np.float64),
)
"""What messages are built from where there is no ROS."""


def stamp_ns(message: Any) -> int:
    """The stamp of a message with a header."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


class ByStamp[Message]:
    """The messages of one topic that came of late, to be found by the stamp of an image.

    first: what serves images that are older than all of them, the first of the recording.
    """

    def __init__(self, first: Message | None = None) -> None:
        self._kept: collections.deque[tuple[int, Message]] = collections.deque(maxlen=_KEPT)
        self._first = first

    def add(self, stamp: int, message: Message) -> None:
        self._kept.append((stamp, message))

    def has(self, stamp: int) -> bool:
        """Whether a message of this very stamp is there."""
        return self.exact(stamp) is not None

    def exact(self, stamp: int) -> Message | None:
        """The message of this very stamp."""
        return next((message for kept, message in reversed(self._kept) if kept == stamp), None)

    def valid_at(self, stamp: int) -> Message | None:
        """The message of this stamp, else the newest one before it, else the first of all."""
        if (found := self.exact(stamp)) is not None:
            return found
        before = [(kept, index) for index, (kept, _) in enumerate(self._kept) if kept < stamp]
        return self._kept[max(before)[1]][1] if before else self._first
