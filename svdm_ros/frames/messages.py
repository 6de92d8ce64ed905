"""Classes of messages, of rclpy or of any other library, and stereo_msgs/DisparityImage made of them."""
from __future__ import annotations

import array
import dataclasses
import functools
import sys
from collections.abc import Callable, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .matched_frame import END_MARGIN

if TYPE_CHECKING:
    from svdm_core import MatcherParameters

    from .matched_frame import MatchedFrame


@dataclasses.dataclass(frozen=True, slots=True)
class MessageTypes:
    """Classes to build messages from, called with all fields as keywords.

    to_data: any array, contiguous -> what the class takes as `Image.data`. room: shape -> such data for float32, and
    float32 of that shape to be filled, which is that data. to_floats: numbers -> what it takes as float64 arrays.
    """

    disparity_image: Callable[..., Any]
    image: Callable[..., Any]
    compressed_image: Callable[..., Any]
    point_cloud2: Callable[..., Any]
    point_field: Callable[..., Any]
    camera_info: Callable[..., Any]
    region_of_interest: Callable[..., Any]
    to_data: Callable[[NDArray[Any]], Any]
    room: Callable[[tuple[int, ...]], tuple[Any, NDArray[np.float32]]]
    to_floats: Callable[[Sequence[float]], Any]


@functools.cache
def rclpy_types() -> MessageTypes:
    """The classes of a ROS installation."""
    from sensor_msgs.msg import CameraInfo, CompressedImage, Image, PointCloud2, PointField, RegionOfInterest
    from stereo_msgs.msg import DisparityImage

    return MessageTypes(DisparityImage, Image, CompressedImage, PointCloud2, PointField, CameraInfo, RegionOfInterest,
                        _byte_array, _byte_array_room, list)


def _byte_array(values: NDArray[Any]) -> array.array[int]:
    data = array.array('B')  # any other type is copied element by element: 100 times slower
    data.frombytes(memoryview(values).cast('B'))
    return data


def _byte_array_room(shape: tuple[int, ...]) -> tuple[array.array[int], NDArray[np.float32]]:
    data = array.array('B', [0]) * (4 * int(np.prod(shape)))
    return data, np.frombuffer(data, np.float32).reshape(shape)


def disparity_image(frame: MatchedFrame, types: MessageTypes) -> Any:
    """stereo_msgs/DisparityImage, in the convention d = x_left - x_right - (cx_left - cx_right).

    Everything that is a disparity is shifted by the principal offset, the ends of the search range as well, which the
    message has END_MARGIN further out. Where there is none it is min_disparity - 1, below the range as stereo_msgs
    defines invalid. delta_d is the step of the result; where that can be any float32, their spacing at the far end of
    the range.
    """
    smallest, largest = frame.limits
    filled = frame.parameters.publish_filled
    return types.disparity_image(
        header=frame.header,
        image=image_message(frame.published, '32FC1', frame.header, types),
        f=frame.geometry.focal_length,
        t=frame.geometry.baseline,
        valid_window=_valid_window(frame.disparity.shape, None if filled else frame.parameters.matcher, types),
        min_disparity=float(smallest) - END_MARGIN,
        max_disparity=float(largest) + END_MARGIN,
        delta_d=frame.step or float(np.spacing(max(abs(smallest), abs(largest)))),
    )


def image_message(values: NDArray[Any], encoding: str, header: Any, types: MessageTypes) -> Any:
    """sensor_msgs/Image of values (H, W) or (H, W, C), of the type and channels that the encoding says."""
    height, width = values.shape[:2]
    return types.image(
        header=header,
        height=height,
        width=width,
        encoding=encoding,
        is_bigendian=int(sys.byteorder == 'big'),
        step=values.nbytes // height,
        data=types.to_data(np.ascontiguousarray(values)),
    )


def _valid_window(shape: tuple[int, ...], parameters: MatcherParameters | None, types: MessageTypes) -> Any:
    """Where a disparity can be: the columns that have a partner under `parameters`; without them, all.

    Columns left of min_disparity have none, and those as close to the right border as the largest disparity is below 0.
    """
    height, width = shape
    left = right = 0
    if parameters is not None:
        left = min(max(parameters.min_disparity, 0), width)
        right = min(max(1 - parameters.min_disparity - parameters.num_disparities, 0), width)
    return types.region_of_interest(x_offset=left, y_offset=0, height=height, width=width - left - right,
                                    do_rectify=False)
