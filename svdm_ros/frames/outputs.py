"""What is made of a matched pair: a new output is a function and a line here.

The node has a publisher for each, and works for those that somebody listens to; `process_bag` writes those it is asked
for.
"""
from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, NamedTuple

from . import confidence, depth, messages, point_cloud, preview, rectified
from .matched_frame import MatchedFrame
from .messages import MessageTypes

if TYPE_CHECKING:
    from ..node.parameter_set import NodeParameters

IMAGE, CAMERA_INFO = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CameraInfo'


class Output(NamedTuple):
    """One topic.

    name: of the output it belongs to. topic: relative. make: the message for a pair. meaning: for the usage text.
    when: under which parameters there is one.
    """

    name: str
    topic: str
    message_type: str
    make: Callable[[MatchedFrame, MessageTypes], Any]
    meaning: str
    when: Callable[[NodeParameters], bool] = lambda _: True


def _is_raw(parameters: NodeParameters) -> bool:
    return parameters.input == 'raw'


OUTPUTS = (
    Output('disparity', 'disparity', 'stereo_msgs/msg/DisparityImage', messages.disparity_image, 'px'),
    Output('depth', 'depth/image_rect', IMAGE, depth.depth_image, 'm, NaN unknown; or mm, see depth_encoding'),
    Output('depth', 'depth/camera_info', CAMERA_INFO, depth.camera_info, 'of depth and disparity as they are'),
    Output('points', 'points2', 'sensor_msgs/msg/PointCloud2', point_cloud.point_cloud, 'x y z in m, rgb or intensity'),
    Output('confidence', 'confidence', IMAGE, confidence.confidence_image, '0 to 1, higher is better'),
    Output('preview', 'disparity/preview', IMAGE, preview.preview_image, 'disparity in colours'),
    Output('preview', 'disparity/preview/compressed', 'sensor_msgs/msg/CompressedImage', preview.compressed_preview,
           'the same as JPEG'),
    Output('rectified', 'left/image_rect', IMAGE, rectified.left_image, 'what the disparity belongs to, of raw images',
           _is_raw),
    Output('rectified', 'left/camera_info_rect', CAMERA_INFO, depth.camera_info, 'its camera_info', _is_raw),
)


def output_names(parameters: NodeParameters) -> tuple[str, ...]:
    """Of the outputs that there are under these parameters: disparity, depth, ..."""
    return tuple(dict.fromkeys(output.name for output in OUTPUTS if output.when(parameters)))
