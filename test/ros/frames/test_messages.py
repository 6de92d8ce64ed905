"""DisparityImage: every field, in the convention d = x_left - x_right - (cx_left - cx_right)."""
import sys

import numpy as np
import pytest
from builtin_interfaces.msg import Time
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from std_msgs.msg import Header

from svdm_core import DisparityResult, MatcherParameters
from svdm_ros.calibration.geometry import StereoGeometry
from svdm_ros.frames import messages
from svdm_ros.frames.matched_frame import MatchedFrame
from svdm_ros.node.parameter_set import NodeParameters

HEADER = Header(stamp=Time(sec=12, nanosec=34), frame_id='left_camera')
GEOMETRY = StereoGeometry(focal_length=500.0, baseline=0.25, principal_offset=3.5)
PARAMETERS = MatcherParameters(min_disparity=4, num_disparities=16, subpixel=False)


def result_of(disparity, valid=None, step=1.0):
    disparity = np.asarray(disparity, np.float32)
    valid = np.ones(disparity.shape, bool) if valid is None else np.asarray(valid)
    return DisparityResult(disparity, valid, valid.astype(np.float32), {}, step)


def disparity_image(result, geometry, matcher, header, publish_filled=True):
    parameters = NodeParameters(matcher, publish_filled=publish_filled)
    frame = MatchedFrame(header, np.zeros(result.disparity.shape, np.uint8), result.disparity, result.valid,
                         result.confidence, result.step, geometry, parameters)
    return messages.disparity_image(frame, messages.rclpy_types())


def pixels(message):
    """The image as a reader sees it."""
    image = message.image
    assert len(image.data) == image.step * image.height
    return np.frombuffer(image.data, '>f4' if image.is_bigendian else '<f4').reshape(image.height, image.width)


def test_every_field():
    message = disparity_image(result_of([[4, 5, 6.5], [7, 19, 10]]), GEOMETRY, PARAMETERS, HEADER)
    assert message.header == message.image.header == HEADER
    image = message.image
    assert (image.height, image.width, image.encoding, image.step) == (2, 3, '32FC1', 12)
    assert image.is_bigendian == (sys.byteorder == 'big')
    np.testing.assert_array_equal(pixels(message), np.float32([[0.5, 1.5, 3], [3.5, 15.5, 6.5]]))
    assert (message.f, message.t) == (500.0, 0.25)
    assert (message.min_disparity, message.max_disparity) == (0, 16)  # half a px beyond what can occur
    assert message.delta_d == 1.0
    window = message.valid_window
    assert (window.x_offset, window.y_offset, window.width, window.height) == (0, 0, 3, 2)
    assert window.do_rectify is False


def test_pixels_not_measured_are_invalid_unless_filled_ones_are_published():
    result = result_of([[8, 9], [10, 11]], [[True, False], [False, True]])
    np.testing.assert_array_equal(
        pixels(disparity_image(result, GEOMETRY, PARAMETERS, HEADER, publish_filled=True)), [[4.5, 5.5], [6.5, 7.5]])
    sparse = disparity_image(result, GEOMETRY, PARAMETERS, HEADER, publish_filled=False)
    np.testing.assert_array_equal(pixels(sparse), [[4.5, -1], [-1, 7.5]])
    assert sparse.min_disparity - 1 == -1


def test_the_result_itself_is_left_alone():
    result = result_of([[8, 9]], [[True, False]])
    disparity_image(result, GEOMETRY, PARAMETERS, HEADER, publish_filled=False)
    np.testing.assert_array_equal(result.disparity, [[8, 9]])


@pytest.mark.parametrize(('width', 'window'), [(10, (4, 6)), (4, (4, 0)), (3, (3, 0)), (1, (1, 0))])
def test_the_window_of_checked_pixels_begins_at_min_disparity_and_never_underflows(width, window):
    message = disparity_image(result_of(np.full((5, width), 4)), GEOMETRY, PARAMETERS, HEADER, publish_filled=False)
    assert (message.valid_window.x_offset, message.valid_window.width) == window
    assert message.valid_window.height == 5


@given(
    shape=npst.array_shapes(min_dims=2, max_dims=2, max_side=6), smallest=st.integers(-1024, 1024),
    count=st.integers(1, 1024), offset=st.floats(-2000, 2000), subpixel=st.booleans(), data=st.data())
def test_valid_disparities_are_within_the_published_range_and_invalid_ones_below(
        shape, smallest, count, offset, subpixel, data):
    parameters = MatcherParameters(min_disparity=smallest, num_disparities=count, subpixel=subpixel)
    within = st.floats(smallest, smallest + count - 1, width=32)
    disparity = data.draw(npst.arrays(np.float32, shape, elements=within))
    valid = data.draw(npst.arrays(bool, shape))
    geometry = StereoGeometry(100.0, 0.1, offset)
    message = disparity_image(result_of(disparity, valid), geometry, parameters, HEADER, publish_filled=False)
    published = pixels(message)
    assert (published[valid] > np.float32(message.min_disparity)).all()
    assert (published[valid] < np.float32(message.max_disparity)).all()
    assert (published[~valid] < np.float32(message.min_disparity)).all()
    np.testing.assert_allclose(published[valid] + offset, disparity[valid], atol=1e-3)


@pytest.mark.parametrize('offset', [0.0, 3.5, -31.086, 1e5])
def test_the_first_and_the_last_disparity_are_within_limits_that_are_tested_strictly(offset):
    """As rtabmap does: min < d < max, else the pixel is dropped."""
    message = disparity_image(
        result_of([[4, 19, 7]], [[True, True, False]]), StereoGeometry(100.0, 0.1, offset), PARAMETERS, HEADER, False)
    low, high = np.float32(message.min_disparity), np.float32(message.max_disparity)
    published = pixels(message)
    assert ((low < published) & (published < high)).tolist() == [[True, True, False]]
    assert published[0, 2] == low - 1


@pytest.mark.parametrize(('smallest', 'count', 'width', 'window'), [
    (-3, 16, 10, (0, 10)), (-20, 16, 10, (0, 5)), (-20, 17, 10, (0, 6)), (-1024, 16, 10, (0, 0)),
    (-16, 16, 10, (0, 9))])
def test_the_window_below_0_ends_where_the_largest_disparity_leads_out_of_the_image(smallest, count, width, window):
    """Pixel x meets x - d of the right image: with all d below 0, the last columns meet none."""
    parameters = MatcherParameters(min_disparity=smallest, num_disparities=count)
    result = result_of(np.full((5, width), smallest))
    sparse = disparity_image(result, GEOMETRY, parameters, HEADER, publish_filled=False)
    assert (sparse.valid_window.x_offset, sparse.valid_window.width) == window
    partners = [any(0 <= x - d < width for d in range(smallest, smallest + count)) for x in range(width)]
    assert partners == [x < window[1] for x in range(width)]
    filled = disparity_image(result, GEOMETRY, parameters, HEADER)
    assert (filled.valid_window.x_offset, filled.valid_window.width) == (0, width)
    assert (filled.min_disparity, filled.max_disparity) == (smallest - 4, smallest + count - 4)


def test_the_step_is_the_results_or_that_of_float32():
    parameters = MatcherParameters(num_disparities=64, subpixel=True)
    assert disparity_image(result_of([[0.0]], step=1 / 64), StereoGeometry(), parameters, HEADER).delta_d == 1 / 64
    message = disparity_image(result_of([[0.0]], step=0.0), StereoGeometry(), parameters, HEADER)
    assert message.delta_d == np.nextafter(np.float32(63), np.float32(64)) - np.float32(63)


def test_an_unknown_geometry_is_zero():
    message = disparity_image(result_of([[5]]), StereoGeometry(problem='no camera_info'), PARAMETERS, HEADER)
    assert (message.f, message.t, message.min_disparity, message.max_disparity) == (0, 0, 3.5, 19.5)


@pytest.mark.parametrize('disparity', [np.full((6, 8), 5, np.float32).T, np.full((6, 16), 5, np.float32)[:, ::2]])
def test_any_memory_layout_is_taken(disparity):
    message = disparity_image(result_of(disparity), StereoGeometry(), PARAMETERS, HEADER)
    np.testing.assert_array_equal(pixels(message), disparity)
