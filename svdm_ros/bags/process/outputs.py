"""The messages that a processed pair gives: disparity, and on demand depth with its camera_info."""
from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...frames.messages import float_image
from ..reading.pair_stream import RecordedPair
from ..reading.recorded_frames import ROS2, TYPES
from ..reading.recording import Recording
from ..reading.stereo_topics import CAMERA_INFO, DISPARITY, IMAGE, StereoTopics, info_name
from ..writing.partial_bag import OutputTopic

DISPARITY_TOPIC = '/disparity'
DEPTH_TOPIC = '/depth/image'
DEPTH_INFO_TOPIC = '/depth/camera_info'


@dataclasses.dataclass(frozen=True, slots=True)
class Outputs:
    """What is written beside the disparity. copied: topics of the input; calibrated: write the camera_info given."""

    topics: StereoTopics
    copied: frozenset[str]
    depth: bool
    calibrated: bool

    def declared(self, recording: Recording) -> list[OutputTopic]:
        """All topics of the output. Raises ValueError where the input has one of the same name."""
        own = [(DISPARITY_TOPIC, DISPARITY)]
        own += [(DEPTH_TOPIC, IMAGE), (DEPTH_INFO_TOPIC, CAMERA_INFO)] if self.depth else []
        own += [(name, CAMERA_INFO) for name in self._info_names] if self.calibrated else []
        for name, _ in own:
            if name in self.copied:
                raise ValueError(f'{name} is a topic of the recording and one of the results: leave out --copy-inputs')
        copies = [recording.topics[name] for name in sorted(self.copied)]
        return [*(OutputTopic(name, kind, ROS2) for name, kind in own),
                *(OutputTopic(topic.name, topic.message_type, recording.typestore, topic.qos) for topic in copies)]

    def messages(self, pair: RecordedPair, disparity: Any) -> Iterator[tuple[str, memoryview]]:
        """Topic and CDR of each message of one pair."""
        yield DISPARITY_TOPIC, ROS2.serialize_cdr(disparity, DISPARITY)
        if self.depth:
            yield DEPTH_TOPIC, ROS2.serialize_cdr(depth_image(disparity), IMAGE)
            if pair.left_info is not None:
                info = dataclasses.replace(pair.left_info, header=disparity.header)
                yield DEPTH_INFO_TOPIC, ROS2.serialize_cdr(info, CAMERA_INFO)
        if self.calibrated:
            for name, info, image in zip(self._info_names, (pair.left_info, pair.right_info), (pair.left, pair.right),
                                         strict=True):
                assert info is not None  # it is the calibration's
                stamped = dataclasses.replace(info, header=image.message.header)
                yield name, ROS2.serialize_cdr(stamped, CAMERA_INFO)

    @property
    def _info_names(self) -> Sequence[str]:
        return info_name(self.topics.left), info_name(self.topics.right)


def pixels_of(image: Any) -> NDArray[np.float32]:
    """The values of a sensor_msgs/Image of encoding 32FC1, float32 (H, W). Raises ValueError for another encoding."""
    if image.encoding != '32FC1':
        raise ValueError(f'encoding {image.encoding!r} holds no disparity: it must be 32FC1')
    stored = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, :4 * image.width]
    values = np.ascontiguousarray(stored).view('>f4' if image.is_bigendian else '<f4')
    return values if sys.byteorder == 'little' and not image.is_bigendian else values.astype(np.float32)


def depth_image(disparity: Any) -> Any:
    """Z = f T / d as sensor_msgs/Image 32FC1, m; NaN where there is no valid disparity, or f or T is unknown (0)."""
    values = pixels_of(disparity.image)
    valid = (values >= disparity.min_disparity) & (values > 0) & (disparity.f * disparity.t > 0)
    depth = np.full(values.shape, np.nan, np.float32)
    np.divide(np.float32(disparity.f * disparity.t), values, out=depth, where=valid)
    return float_image(depth, disparity.header, TYPES)
