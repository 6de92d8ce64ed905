"""The matcher's result as stereo_msgs/DisparityImage."""
from __future__ import annotations

import array
import sys
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import RegionOfInterest
from stereo_msgs.msg import DisparityImage

if TYPE_CHECKING:
    from std_msgs.msg import Header

    from svdm_core import DisparityResult, MatcherParameters

    from .camera_geometry import StereoGeometry


def disparity_image(
    result: DisparityResult,
    geometry: StereoGeometry,
    parameters: MatcherParameters,
    header: Header,
    publish_filled: bool = True,
) -> DisparityImage:
    """The message for one result, in the convention d = x_left - x_right - (cx_left - cx_right).

    Everything that is a disparity is shifted by the principal offset, the ends of the search range as well.
    With `publish_filled` every pixel has a disparity; without it those that failed the left-right check are
    min_disparity - 1, below the range as stereo_msgs defines invalid.
    """
    # All in float32, so that no valid disparity is rounded to below min_disparity.
    offset = np.float32(geometry.principal_offset)
    smallest = np.float32(parameters.min_disparity) - offset
    largest = np.float32(parameters.min_disparity + parameters.num_disparities - 1) - offset
    disparity = result.disparity - offset
    if not publish_filled:
        disparity[~result.valid] = smallest - np.float32(1)

    message = DisparityImage(header=header)
    _fill_image(message, disparity)
    message.f = geometry.focal_length
    message.t = geometry.baseline
    message.min_disparity = float(smallest)
    message.max_disparity = float(largest)
    message.delta_d = _disparity_step(parameters, smallest, largest)
    message.valid_window = _valid_window(disparity.shape, 0 if publish_filled else parameters.min_disparity)
    return message


def _fill_image(message: DisparityImage, disparity: NDArray[np.float32]) -> None:
    image = message.image
    image.header = message.header
    image.height, image.width = disparity.shape
    image.encoding = '32FC1'
    image.is_bigendian = int(sys.byteorder == 'big')
    image.step = image.width * disparity.itemsize
    pixels = array.array('B')  # any other type is copied element by element: 100 times slower
    pixels.frombytes(memoryview(np.ascontiguousarray(disparity)).cast('B'))
    image.data = pixels


def _disparity_step(parameters: MatcherParameters, smallest: np.float32, largest: np.float32) -> float:
    """1 px; sub-pixel gives any float32, so there the step is the spacing of float32 at the far end of the range."""
    return float(np.spacing(max(abs(smallest), abs(largest)))) if parameters.subpixel and largest > smallest else 1.0


def _valid_window(shape: tuple[int, ...], unmatched_columns: int) -> RegionOfInterest:
    """Where a disparity can be: columns left of min_disparity have no partner and are known only by filling."""
    height, width = shape
    left = min(unmatched_columns, width)
    return RegionOfInterest(x_offset=left, y_offset=0, width=width - left, height=height, do_rectify=False)
