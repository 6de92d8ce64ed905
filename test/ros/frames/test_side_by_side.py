"""One image of both views: its halves, and the camera_info of a half."""
import copy

import numpy as np
import pytest
from planes import camera_info as plain_info
from rosbags.typesys import Stores, get_typestore
from scenes import noise
from sensor_msgs.msg import CameraInfo, RegionOfInterest

from svdm_ros.calibration.rectification import Rectification
from svdm_ros.frames.side_by_side import half_info, halves

WIDTH, HEIGHT, F, CX, CY = 1280, 480, 500.0, 310.0, 250.0
K = [F, 0.0, CX, 0.0, F, CY, 0.0, 0.0, 1.0]
P = [400.0, 0.0, CX + 5, -40.0, 0.0, 400.0, CY, 0.0, 0.0, 0.0, 1.0, 0.0]
ROS2 = get_typestore(Stores.ROS2_JAZZY)


def of_rclpy(width=WIDTH, height=HEIGHT, shift=0.0, roi=(0, 0, 0, 0), **fields):
    x, y, roi_width, roi_height = roi
    info = CameraInfo(width=width, height=height, k=K, p=P, r=np.eye(3).ravel(), d=[0.1] * 5,
                      distortion_model='plumb_bob', **fields,
                      roi=RegionOfInterest(x_offset=x, y_offset=y, width=roi_width, height=roi_height))
    info.k[2] += shift
    info.p[2] += shift
    return info


def of_rosbags():
    """As read from a recording: its arrays cannot be written."""
    types = ROS2.types
    header = types['std_msgs/msg/Header'](types['builtin_interfaces/msg/Time'](1, 2), 'frame')
    roi = types['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False)
    written = types['sensor_msgs/msg/CameraInfo'](
        header, HEIGHT, WIDTH, 'plumb_bob', np.full(5, 0.1), np.array(K), np.eye(3).ravel(), np.array(P), 0, 0, roi)
    return ROS2.deserialize_cdr(ROS2.serialize_cdr(written, written.__msgtype__), written.__msgtype__)


@pytest.mark.parametrize('shape', [(4, 6), (4, 6, 3), (1, 2), (5, 2, 4)])
@pytest.mark.parametrize('dtype', [np.uint8, np.uint16])
def test_halves_are_views_that_make_up_the_whole(shape, dtype):
    pixels = noise(*shape, dtype=dtype)
    left, right = halves(pixels)
    assert left.shape == right.shape == (shape[0], shape[1] // 2, *shape[2:])
    assert np.shares_memory(left, pixels) and np.shares_memory(right, pixels)
    np.testing.assert_array_equal(np.concatenate([left, right], 1), pixels)


@pytest.mark.parametrize('width', [0, 1, 641])
def test_an_odd_width_is_refused(width):
    with pytest.raises(ValueError, match=f'{width}x4 px, its width must be even') as refusal:
        halves(np.zeros((4, width, 3), np.uint8))
    assert str(refusal.value).isprintable()


@pytest.mark.parametrize('make', [of_rclpy, of_rosbags])
@pytest.mark.parametrize('side', ['left', 'right'])
def test_an_info_of_the_whole_image_gets_half_the_width_and_nothing_else(make, side):
    info = make()
    before = copy.deepcopy(info)
    half = half_info(info, side, WIDTH, HEIGHT)
    assert (half.width, half.height, type(half)) == (WIDTH // 2, HEIGHT, type(info))
    for name in ('k', 'd', 'r', 'p'):
        np.testing.assert_array_equal(getattr(half, name), getattr(before, name))
        np.testing.assert_array_equal(getattr(info, name), getattr(before, name))
    assert (half.header, half.distortion_model, half.roi) == (before.header, before.distortion_model, before.roi)
    assert info.width == WIDTH, 'the message that came is left alone'


def test_the_centre_of_the_right_half_is_counted_from_its_own_edge():
    half = half_info(of_rclpy(shift=WIDTH / 2), 'right', WIDTH, HEIGHT)
    np.testing.assert_array_equal(half.k, K)
    np.testing.assert_array_equal(half.p, P)


@pytest.mark.parametrize(('width', 'height'), [(WIDTH // 2, HEIGHT), (0, 0), (640, 360), (WIDTH, 0)])
def test_an_info_of_the_half_or_of_something_else_comes_back_as_it_is(width, height):
    info = of_rclpy(width, height)
    assert half_info(info, 'right', WIDTH, HEIGHT) is info


@pytest.mark.parametrize(('image', 'fields'), [
    ((WIDTH // 2, HEIGHT // 2), {}), ((WIDTH // 2, HEIGHT // 2), {'binning_x': 2, 'binning_y': 2}),
    ((426, 160), {'binning_x': 3, 'binning_y': 3}), ((WIDTH, HEIGHT), {'roi': (0, 0, WIDTH, HEIGHT)})])
def test_binning_scaling_and_a_roi_of_all_still_tell_of_the_whole(image, fields):
    half = half_info(of_rclpy(**fields), 'left', *image)
    assert half.width == WIDTH // 2
    assert half.roi.width == (WIDTH // 2 if 'roi' in fields else 0)


@pytest.mark.parametrize(('info', 'side', 'told'), [
    (of_rclpy(roi=(10, 0, 640, 480)), 'left', r'roi of 640x480 px at \(10, 0\)'),
    (of_rclpy(roi=(0, 0, 640, 0)), 'left', 'roi of 640x0'),
    (of_rclpy(shift=WIDTH / 2), 'left', 'of the left half has c_x = 950 px, it must be within the half, which is 640'),
    (of_rclpy(shift=WIDTH), 'right', 'of the right half has c_x = 1590 px'),
    (of_rclpy(shift=-400.0), 'right', 'c_x = -90 px'),
    (of_rclpy(shift=np.nan), 'right', 'c_x = nan px')])
def test_what_cannot_be_halved_is_refused_in_one_line(info, side, told):
    with pytest.raises(ValueError, match=told) as refusal:
        half_info(info, side, WIDTH, HEIGHT)
    assert str(refusal.value).isprintable()


def test_the_right_half_is_rectified_as_an_image_of_its_own():
    whole = noise(HEIGHT, WIDTH)
    own = plain_info((WIDTH // 2, HEIGHT), 'plumb_bob', [0.1, -0.02, 0, 0], [F, F, CX, CY], (0.01, 0.02, 0),
                     (F, CX, CY, -40.0))
    told = copy.deepcopy(own)
    told.width = WIDTH
    told.k[2] += WIDTH / 2
    told.p[2] += WIDTH / 2
    right = halves(whole)[1]
    found = Rectification.of(half_info(told, 'right', WIDTH, HEIGHT), *right.shape[::-1])(right)
    np.testing.assert_array_equal(found, Rectification.of(own, *right.shape[::-1])(np.ascontiguousarray(right)))
