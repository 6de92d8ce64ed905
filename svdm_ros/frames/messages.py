"""The matcher's result as stereo_msgs/DisparityImage, in the classes of rclpy or of any other library of messages."""
from __future__ import annotations

import array
import dataclasses
import functools
import sys
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from std_msgs.msg import Header
    from stereo_msgs.msg import DisparityImage

    from svdm_core import DisparityResult, MatcherParameters

    from ..calibration.geometry import StereoGeometry


@dataclasses.dataclass(frozen=True, slots=True)
class MessageTypes:
    """Classes to build messages from, called with all fields as keywords.

    to_data: float32 (H, W), contiguous -> what the class takes as `Image.data`.
    """

    disparity_image: Callable[..., Any]
    image: Callable[..., Any]
    region_of_interest: Callable[..., Any]
    to_data: Callable[[NDArray[np.float32]], Any]


@functools.cache
def rclpy_types() -> MessageTypes:
    """The classes of a ROS installation."""
    from sensor_msgs.msg import Image, RegionOfInterest
    from stereo_msgs.msg import DisparityImage

    return MessageTypes(DisparityImage, Image, RegionOfInterest, _byte_array)


def _byte_array(pixels: NDArray[np.float32]) -> array.array[int]:
    data = array.array('B')  # any other type is copied element by element: 100 times slower
    data.frombytes(memoryview(pixels).cast('B'))
    return data


def disparity_image(
    result: DisparityResult,
    geometry: StereoGeometry,
    parameters: MatcherParameters,
    header: Header,
    publish_filled: bool = True,
    types: MessageTypes | None = None,
) -> DisparityImage:
    """The message for one result, in the convention d = x_left - x_right - (cx_left - cx_right).

    Everything that is a disparity is shifted by the principal offset, the ends of the search range as well.
    With `publish_filled` every pixel has a disparity; without it those that failed the left-right check are
    min_disparity - 1, below the range as stereo_msgs defines invalid. delta_d is the step of the result; where that
    can be any float32, their spacing at the far end of the range. `types` are the classes to build it from,
    those of rclpy by default.
    """
    # All in float32, so that no valid disparity is rounded to below min_disparity.
    offset = np.float32(geometry.principal_offset)
    smallest = np.float32(parameters.min_disparity) - offset
    largest = np.float32(parameters.min_disparity + parameters.num_disparities - 1) - offset
    disparity = result.disparity - offset
    if not publish_filled:
        disparity[~result.valid] = smallest - np.float32(1)

    types = types or rclpy_types()
    return types.disparity_image(
        header=header,
        image=float_image(disparity, header, types),
        f=geometry.focal_length,
        t=geometry.baseline,
        valid_window=_valid_window(disparity.shape, None if publish_filled else parameters, types),
        min_disparity=float(smallest),
        max_disparity=float(largest),
        delta_d=result.step or float(np.spacing(max(abs(smallest), abs(largest)))),
    )


def float_image(values: NDArray[np.float32], header: Header, types: MessageTypes) -> Any:
    """sensor_msgs/Image of encoding 32FC1. values: float32 (H, W)."""
    height, width = values.shape
    return types.image(
        header=header,
        height=height,
        width=width,
        encoding='32FC1',
        is_bigendian=int(sys.byteorder == 'big'),
        step=width * values.itemsize,
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
