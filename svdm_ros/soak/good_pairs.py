"""The pairs that are answered, and what the answers must be: made offline from the same pair and parameters."""
from __future__ import annotations

import functools
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray
from rclpy.serialization import deserialize_message, serialize_message
from stereo_msgs.msg import DisparityImage

from ..frames.frame_processing import FrameProcessor
from ..frames.messages import disparity_image, rclpy_types
from ..frames.views import StereoFrame
from ..node.parameter_set import NodeParameters
from ..processes.camera import camera_info_message, image_message
from ..processes.scene import load_scene

COUNT = 4
Size = tuple[int, int]
"""Width and height of images, px."""
_SEPARATOR = ' '
_CYCLE, _HOSTILE, _SURE = 20, 10, 12
"""s: hostile calibrations come in the first ten of twenty seconds; from the twelfth on, a right one has surely come."""
_BY_CALIBRATION = frozenset(('f', 't', 'min_disparity', 'max_disparity', 'image.data'))


@functools.cache
def good_pairs(size: Size) -> tuple[tuple[NDArray[np.uint8], NDArray[np.uint8]], ...]:
    """COUNT grey pairs: the scene, its rows turned round by a number that differs."""
    scene = load_scene()
    views = [cv2.resize(cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY), size, interpolation=cv2.INTER_AREA)
             for pixels in (scene.left, scene.right)]
    return tuple(tuple(np.roll(np.asarray(view, np.uint8), 37 * index, axis=0) for view in views)  # type: ignore[misc]
                 for index in range(COUNT))


def expected_answers(parameters: NodeParameters, size: Size) -> list[DisparityImage]:
    """What the node has to publish for each of the pairs, except the header. FrameError where the pairs are too small.
    """
    width, height = size
    processor = FrameProcessor()
    left_info, right_info = (camera_info_message(side, height, width) for side in ('left', 'right'))
    frames = [StereoFrame(image_message(left), image_message(right), left_info, right_info, arrived=0.0)
              for left, right in good_pairs(size)]
    made = [disparity_image(processor.process(frame, parameters).frame, rclpy_types()) for frame in frames]
    return [deserialize_message(serialize_message(message), DisparityImage) for message in made]  # f and t are float32


def differing(answer: DisparityImage, expected: DisparityImage) -> list[str]:
    """The fields that differ, all but the headers; bytes of the image included."""
    return [name for name, value in _fields(expected).items() if _fields(answer)[name] != value]


def _fields(message: DisparityImage) -> dict[str, Any]:
    image = {f'image.{name}': getattr(message.image, name)
             for name in message.image.get_fields_and_field_types() if name != 'header'}
    return image | {name: getattr(message, name) for name in message.get_fields_and_field_types()
                    if name not in ('header', 'image')}


def hostile_calibrations_come(sent_ns: int) -> bool:
    """Whether at this time (wall clock, ns).

    A calibration may be lost or late, as any message, and the node then has to take the latest that came: so there are
    times in which all that come are right.
    """
    return sent_ns // 10**9 % _CYCLE < _HOSTILE


def may_have_other_calibration(sent_ns: int, wrong: Sequence[str]) -> bool:
    """Whether fields of an answer may differ as another calibration came last."""
    return sent_ns // 10**9 % _CYCLE < _SURE and {'f', 't'} & set(wrong) != set() and set(wrong) <= _BY_CALIBRATION


def frame_id(number: int, pair: int, sent_ns: int) -> str:
    """The frame_id by which an answer is known: a number of its own, which pair it is, and the wall clock when sent."""
    return _SEPARATOR.join(map(str, ('good', number, pair, sent_ns)))


def parse_frame_id(text: str) -> tuple[int, int, int] | None:
    """What `frame_id` was made of; None of an answer to anything else."""
    kind, *numbers = text.split(_SEPARATOR)
    if kind != 'good' or len(numbers) != 3 or not all(number.isdigit() for number in numbers):
        return None
    number, pair, sent_ns = map(int, numbers)
    return number, pair, sent_ns
