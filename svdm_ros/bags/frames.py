"""What lies in a recording as the messages the matcher's side takes: images, decoded, and camera_info by time."""
from __future__ import annotations

import collections
import dataclasses
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from ..frame_processing import FrameError
from ..frames.compressed import decode
from ..messages import MessageTypes
from .calibration import StereoCalibration
from .stereo_messages import Moment, camera_info_bytes
from .stereo_topics import CAMERA_INFO, COMPRESSED

ROS2 = get_typestore(Stores.ROS2_JAZZY)
"""The types of all that is written."""

_KEPT = 1000


def _bytes_of(pixels: NDArray[np.float32]) -> NDArray[np.uint8]:
    return pixels.reshape(-1).view(np.uint8)


TYPES = MessageTypes(
    ROS2.types['stereo_msgs/msg/DisparityImage'],
    ROS2.types['sensor_msgs/msg/Image'],
    ROS2.types['sensor_msgs/msg/RegionOfInterest'],
    _bytes_of,
)
"""What DisparityImage and Image are built from where there is no ROS."""


def stamp_ns(message: Any) -> int:
    """The stamp of a message with a header."""
    stamp = message.header.stamp
    return int(stamp.sec) * 10**9 + int(stamp.nanosec)


def as_image(message: Any, message_type: str, side: str) -> Any:
    """A sensor_msgs/Image of either kind of image message. Raises FrameError where it cannot be decoded."""
    if message_type != COMPRESSED:
        return message
    try:
        pixels, encoding = decode(message)
    except ValueError as error:
        raise FrameError('unreadable', f'{side} image dropped: {error}') from error
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
    return TYPES.image(header=message.header, height=height, width=width, encoding=encoding,
                       is_bigendian=int(sys.byteorder == 'big'), step=data.size // height, data=data)


def infos_of(calibration: StereoCalibration) -> tuple[Any, Any]:
    """sensor_msgs/CameraInfo of the left and the right camera; 0x0 px, which fits any image, where it has no size."""
    cameras = calibration.left, calibration.right
    left, right = (
        ROS2.deserialize_cdr(camera_info_bytes(dataclasses.replace(camera, size=camera.size or (0, 0)), Moment(0, '')),
                             CAMERA_INFO)
        for camera in cameras)
    return left, right


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
