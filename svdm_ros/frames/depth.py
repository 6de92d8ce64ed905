"""Depth in metres as sensor_msgs/Image, and the camera_info that belongs to it (REP 117, REP 118)."""
from __future__ import annotations

from typing import Any

import numpy as np

from .matched_frame import MatchedFrame
from .messages import MessageTypes, image_message

_MOST_MM = 65535


def depth_image(frame: MatchedFrame, types: MessageTypes) -> Any:
    """32FC1 in m, NaN where it is not known; or 16UC1 in mm, 0 where it is not known or beyond 65.535 m."""
    if frame.parameters.depth_encoding == '32FC1':
        return image_message(frame.depth, '32FC1', frame.header, types)
    millimetres = np.rint(1000 * frame.depth)
    fits = millimetres <= _MOST_MM  # False for NaN
    return image_message(np.where(fits, millimetres, 0).astype(np.uint16), '16UC1', frame.header, types)


def camera_info(frame: MatchedFrame, types: MessageTypes) -> Any:
    """sensor_msgs/CameraInfo of the left image as it was matched: its size, without distortion, binning and roi."""
    height, width = frame.disparity.shape
    geometry = frame.geometry
    fx, fy, cx, cy = geometry.focal_length, geometry.focal_length_y, geometry.cx, geometry.cy
    return types.camera_info(
        header=frame.header, height=height, width=width, distortion_model='plumb_bob',
        d=types.to_floats([0.0] * 5), k=types.to_floats([fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0]),
        r=types.to_floats([1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]),
        p=types.to_floats([fx, 0.0, cx, 0.0, 0.0, fy, cy, 0.0, 0.0, 0.0, 1.0, 0.0]), binning_x=0, binning_y=0,
        roi=types.region_of_interest(x_offset=0, y_offset=0, height=0, width=0, do_rectify=False))
