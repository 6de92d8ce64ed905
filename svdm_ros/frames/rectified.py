"""The left image as it was matched: rectified, cut out and shrunk."""
from __future__ import annotations

from typing import Any

from .matched_frame import MatchedFrame
from .messages import MessageTypes, image_message

_ENCODINGS = {(2, 1): 'mono8', (2, 2): 'mono16', (3, 1): 'bgr8', (3, 2): 'bgr16'}
"""By dimensions, and bytes a channel."""


def left_image(frame: MatchedFrame, types: MessageTypes) -> Any:
    """sensor_msgs/Image: mono8, mono16, bgr8 or bgr16."""
    return image_message(frame.left, _ENCODINGS[frame.left.ndim, frame.left.itemsize], frame.header, types)
