"""How far each disparity can be trusted."""
from __future__ import annotations

from typing import Any

from .matched_frame import MatchedFrame
from .messages import MessageTypes, image_message


def confidence_image(frame: MatchedFrame, types: MessageTypes) -> Any:
    """sensor_msgs/Image 32FC1, 0 .. 1, of every pixel; no filter leaves out any."""
    return image_message(frame.confidence, '32FC1', frame.header, types)
