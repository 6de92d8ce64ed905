"""The messages that a processed pair gives: the outputs asked for, made by the functions that the node has."""
from __future__ import annotations

import dataclasses
from collections.abc import Iterator

from svdm_core.shown import cut

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
