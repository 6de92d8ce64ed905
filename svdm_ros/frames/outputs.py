"""What is made of a matched pair: a new output is a function and a line here.

The node has a publisher for each, and works for those that somebody listens to; `process_bag` writes those it is asked
for.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from . import confidence, depth, messages, point_cloud, preview
from .matched_frame import MatchedFrame
from .messages import MessageTypes

IMAGE, CAMERA_INFO = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CameraInfo'


class Output(NamedTuple):
    """One topic.

    name: of the output it belongs to. topic: relative. make: the message for a pair. meaning: for the usage text.
    """

    name: str
    topic: str
    message_type: str
    make: Callable[[MatchedFrame, MessageTypes], Any]
    meaning: str


OUTPUTS = (
    Output('disparity', 'disparity', 'stereo_msgs/msg/DisparityImage', messages.disparity_image, 'px'),
    Output('depth', 'depth/image_rect', IMAGE, depth.depth_image, 'm, NaN unknown; or mm, see depth_encoding'),
    Output('depth', 'depth/camera_info', CAMERA_INFO, depth.camera_info, 'of depth and disparity as they are'),
    Output('points', 'points2', 'sensor_msgs/msg/PointCloud2', point_cloud.point_cloud, 'x y z in m, rgb or intensity'),
    Output('confidence', 'confidence', IMAGE, confidence.confidence_image, '0 to 1, higher is better'),
    Output('preview', 'disparity/preview', IMAGE, preview.preview_image, 'disparity in colours'),
    Output('preview', 'disparity/preview/compressed', 'sensor_msgs/msg/CompressedImage', preview.compressed_preview,
           'the same as JPEG'),
)


def output_names() -> tuple[str, ...]:
    """disparity, depth, ..."""
    return tuple(dict.fromkeys(output.name for output in OUTPUTS))
