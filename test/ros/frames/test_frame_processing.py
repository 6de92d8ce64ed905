"""From a pair of image messages to one disparity message."""
import sys

import numpy as np
from scenes import shifted_wall
from sensor_msgs.msg import Image

from svdm_core import matcher
from svdm_ros.frames.frame_processing import FrameProcessor
from svdm_ros.frames.messages import disparity_image, rclpy_types
from svdm_ros.frames.views import StereoFrame
from svdm_ros.node.parameter_set import NodeParameters


def mono(pixels):
    message = Image(height=pixels.shape[0], width=pixels.shape[1], encoding='mono8', step=pixels.shape[1])
    message.data = pixels.tobytes()
    return message


def test_a_negative_range_goes_through_and_what_is_compiled_is_told_once(monkeypatch):
    """A pair of verged cameras: the wall lies at -5 px."""
    monkeypatch.setattr(matcher, '_RUN', set())  # other tests have matched before
    left, right = shifted_wall(40, 70, 5)
    left, right = np.ascontiguousarray(left[:, ::-1]), np.ascontiguousarray(right[:, ::-1])
    told = []
    processor = FrameProcessor(on_compiling=told.append)
    parameters = NodeParameters().replace({'min_disparity': -12, 'num_disparities': 11, 'publish_filled': False})
    frame = StereoFrame(mono(left), mono(right), None, None, 0.0)
    for _ in range(2):
        message = disparity_image(processor.process(frame, parameters).frame, rclpy_types())
        parameters = parameters.replace({'alpha': 3.0})
    assert told == ['8-bit grey images and 1 to 32 disparities']
    assert (message.min_disparity, message.max_disparity, message.delta_d) == (-12.5, -1.5, 1 / 64)
    assert (message.valid_window.x_offset, message.valid_window.width) == (0, 70 - 2)
    assert message.image.is_bigendian == (sys.byteorder == 'big')
    disparity = np.frombuffer(message.image.data, np.float32).reshape(40, 70)
    inside = disparity[4:-4, 4:-9]
    assert np.abs(inside[inside != -13.5] + 5).max() <= 0.5 and (inside != -13.5).mean() > 0.95
    assert set(disparity[disparity < -12]) <= {np.float32(-13.5)}
