"""Messages without ROS: the classes that are written, and camera_info of a recording by time."""
from __future__ import annotations

import bisect
import collections
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from ...frames.messages import MessageTypes

ROS2 = get_typestore(Stores.ROS2_JAZZY)
"""The types of all that is written."""

_KEPT = 1000
_HEAD_AND_STAMP = 12
"""Bytes of CDR before all but the stamp."""


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
    """The latest messages of one topic, to be found by the stamp of an image; not more than `size` bytes of them."""

    def __init__(self, size: int) -> None:
        self._kept: dict[int, tuple[Message, int]] = {}
        self._room = size

    def add(self, stamp: int, message: Message, size: int) -> None:
        """Keep a message of `size` bytes; the oldest make room."""
        self._room += self._kept.pop(stamp, (None, 0))[1] - size
        while self._room < 0 and self._kept:
            self._room += self._kept.pop(next(iter(self._kept)))[1]
        self._kept[stamp] = message, size

    def has(self, stamp: int) -> bool:
        """Whether a message of this very stamp is there."""
        return stamp in self._kept

    def exact(self, stamp: int) -> Message | None:
        """The message of this very stamp."""
        return self._kept[stamp][0] if stamp in self._kept else None


class CameraInfos:
    """The camera_info of one topic, however many: those are kept at which the calibration changes.

    An image can wait for its partner for long, so that any of them may be asked for. first: what serves images that are
    older than all of them, the first of the recording.
    """

    def __init__(self, first: Any | None = None) -> None:
        self._first = first
        self._stamps: list[int] = []
        self._changes: list[_Info] = []
        self._late: dict[int, _Info] = {}
        self._seen: collections.deque[int] = collections.deque(maxlen=_KEPT)

    def add(self, stamp: int, info: Any, data: bytes) -> None:
        """Take in a camera_info; data: its CDR."""
        added = _Info(info, data[_HEAD_AND_STAMP:])
        self._seen.append(stamp)
        if (known := self._at(stamp)) is not None and known.content == added.content:
            return
        if self._stamps and stamp < self._stamps[-1]:
            self._late[stamp] = added
        else:
            self._stamps.append(stamp)
            self._changes.append(added)

    def has(self, stamp: int) -> bool:
        """Whether one of this very stamp has come of late."""
        return stamp in self._seen

    def valid_at(self, stamp: int) -> Any | None:
        """The one of this stamp, else the newest one before it, else the first of all; its own stamp may be older."""
        found = self._at(stamp)
        return self._first if found is None else found.info

    def _at(self, stamp: int) -> _Info | None:
        if stamp in self._late:
            return self._late[stamp]
        at = bisect.bisect_right(self._stamps, stamp)
        return self._changes[at - 1] if at else None


class _Info(NamedTuple):
    """A camera_info, and its bytes from behind the stamp on."""

    info: Any
    content: bytes
