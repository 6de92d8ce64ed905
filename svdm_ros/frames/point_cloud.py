"""A cloud of points: sensor_msgs/PointCloud2, in the optical frame of the left camera (REP 103)."""
from __future__ import annotations

import sys
from collections.abc import Iterator
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .matched_frame import MatchedFrame
from .messages import MessageTypes

_FLOAT32 = 7  # PointField.FLOAT32
_POINT = 16
"""Bytes of a point: x, y, z, and rgb or intensity."""


def point_cloud(frame: MatchedFrame, types: MessageTypes) -> Any:
    """Organised, every `point_stride`-th pixel of every `point_stride`-th row: x to the right, y down, z ahead, m.

    rgb as PCL has it (the bytes of a float32: blue, green, red, 0) where the images are in colour, else intensity, the
    grey level. Points without a depth are NaN.
    """
    stride = frame.parameters.point_stride
    depth = frame.depth[::stride, ::stride]
    left = frame.left[::stride, ::stride]
    height, width = depth.shape
    data, points = types.room((height, width, _POINT // 4))
    cv2.merge([*_positions(depth, frame, stride), _packed(left)], points)
    fields = [types.point_field(name=name, offset=4 * number, datatype=_FLOAT32, count=1)
              for number, name in enumerate(('x', 'y', 'z', 'rgb' if left.ndim == 3 else 'intensity'))]
    return types.point_cloud2(
        header=frame.header, height=height, width=width, fields=fields, is_bigendian=sys.byteorder == 'big',
        point_step=_POINT, row_step=_POINT * width, data=data, is_dense=False)


def _packed(left: NDArray[Any]) -> NDArray[np.float32]:
    """float32 (H, W): the grey levels, or the bytes blue, green, red, 0."""
    if left.ndim == 2:
        return np.asarray(left, np.float32)
    colours = np.asarray(cv2.cvtColor(left if left.dtype == np.uint8 else (left >> 8).astype(np.uint8),
                                      cv2.COLOR_BGR2BGRA)).view('<u4')[..., 0]
    bytes_: NDArray[np.float32] = np.bitwise_and(colours, 0xFFFFFF, dtype=np.uint32).view(np.float32)
    return bytes_


def _positions(depth: NDArray[np.float32], frame: MatchedFrame, stride: int) -> Iterator[NDArray[np.float32]]:
    """x, y and z of each point: (u - cx) Z / fx, (v - cy) Z / fy, Z."""
    geometry = frame.geometry
    across = (stride * np.arange(depth.shape[1]) - geometry.cx) / (geometry.focal_length or 1)
    down = (stride * np.arange(depth.shape[0]) - geometry.cy) / (geometry.focal_length_y or 1)
    yield depth * across.astype(np.float32)
    yield depth * down.astype(np.float32)[:, None]
    yield depth
