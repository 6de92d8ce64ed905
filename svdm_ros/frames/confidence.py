"""How far each disparity can be trusted."""
from __future__ import annotations

from typing import Any

import numpy as np

from .matched_frame import MatchedFrame
from .messages import MessageTypes, image_message


def confidence_image(frame: MatchedFrame, types: MessageTypes) -> Any:
    """sensor_msgs/Image 32FC1, 0 .. 1: 1 where the left-right check passed, 0 where the disparity is filled in."""
    return image_message(frame.checked.astype(np.float32), '32FC1', frame.header, types)
