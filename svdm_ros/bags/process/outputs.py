"""The messages that a processed pair gives: the outputs asked for, made by the functions that the node has."""
from __future__ import annotations

import dataclasses
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svdm_core.shown import cut, shown

from ...frames.matched_frame import MatchedFrame
from ...frames.outputs import OUTPUTS, Output
from ..reading.pair_stream import RecordedPair
from ..reading.recorded_frames import ROS2, TYPES
from ..reading.recording import Recording
from ..reading.stereo_topics import CAMERA_INFO, StereoTopics
from ..writing.partial_bag import OutputTopic

DISPARITY_TOPIC = '/disparity'


@dataclasses.dataclass(frozen=True, slots=True)
class Outputs:
    """What is written. copied: topics of the input; names: of OUTPUTS; calibrated: write the camera_info given."""

    topics: StereoTopics
    copied: frozenset[str]
    names: tuple[str, ...]
    calibrated: bool

    def declared(self, recording: Recording) -> list[OutputTopic]:
        """All topics of the output. Raises ValueError where the input has one of the same name."""
        own = [(f'/{output.topic}', output.message_type) for output in self._written]
        own += [(name, CAMERA_INFO) for name in self.topics.info_names] if self.calibrated else []
        for name, _ in own:
            if name in self.copied:
                images = name in (self.topics.left, self.topics.right)
                remedy = 'leave out --copy-inputs' if images else 'leave out the output that has it'
                raise ValueError(f'{cut(name)} is a topic of the recording and one of the results: {remedy}')
        copies = [recording.topics[name] for name in sorted(self.copied)]
        return [*(OutputTopic(name, kind, ROS2) for name, kind in own),
                *(OutputTopic(topic.name, topic.message_type, recording.typestore, topic.qos) for topic in copies)]

    def messages(self, pair: RecordedPair, frame: MatchedFrame) -> Iterator[tuple[str, memoryview]]:
        """Topic and CDR of each message of one pair."""
        for output in self._written:
            yield f'/{output.topic}', ROS2.serialize_cdr(output.make(frame, TYPES), output.message_type)
        if self.calibrated:
            for name, info, image in zip(self.topics.info_names, (pair.left_info, pair.right_info),
                                         (pair.left, pair.right), strict=True):
                assert info is not None  # it is the calibration's
                stamped = dataclasses.replace(info, header=image.message.header)
                yield name, ROS2.serialize_cdr(stamped, CAMERA_INFO)

    @property
    def _written(self) -> list[Output]:
        return [output for output in OUTPUTS if output.name in self.names]


def pixels_of(image: Any) -> NDArray[np.float32]:
    """The values of a sensor_msgs/Image of encoding 32FC1, float32 (H, W). Raises ValueError for another encoding."""
    if image.encoding != '32FC1':
        raise ValueError(f'encoding {shown(image.encoding)} holds no disparity: it must be 32FC1')
    if image.step < 4 * image.width or len(image.data) != image.height * image.step or not image.width:
        raise ValueError(f'{len(image.data)} bytes are no {image.width}x{image.height} px of 32FC1 with a step of '
                         f'{image.step}')
    stored = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, :4 * image.width]
    values = np.ascontiguousarray(stored).view('>f4' if image.is_bigendian else '<f4')
    return values if sys.byteorder == 'little' and not image.is_bigendian else values.astype(np.float32)
