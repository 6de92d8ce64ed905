"""The preview as messages: coloured disparities, as they are or as JPEG."""
from __future__ import annotations

from typing import Any

import cv2

from .matched_frame import MatchedFrame
from .messages import MessageTypes, image_message

_JPEG_QUALITY = 90
_LARGEST_JPEG = 65500  # px a side, of the format


def preview_image(frame: MatchedFrame, types: MessageTypes) -> Any:
    """sensor_msgs/Image bgr8: blue is the smallest disparity of the search range, red the largest, black unknown."""
    return image_message(frame.picture, 'bgr8', frame.header, types)


def compressed_preview(frame: MatchedFrame, types: MessageTypes) -> Any:
    """The same as sensor_msgs/CompressedImage: JPEG, or PNG where it is too large for that."""
    kind = 'jpeg' if max(frame.picture.shape) <= _LARGEST_JPEG else 'png'
    _, data = cv2.imencode(f'.{kind}', frame.picture, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY] * (kind == 'jpeg'))
    return types.compressed_image(header=frame.header, format=f'bgr8; {kind} compressed bgr8', data=types.to_data(data))
