"""From a pair of image messages to one disparity message."""
import os
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest
from node_bench import camera_info
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


# The real sequence


def test_the_sky_of_the_real_sequence_has_a_disparity_and_no_depth():
    folder = Path(os.environ.get('SVDM_DATA', 'unset')) / 'kitti_odometry_seq1'
    if not folder.is_dir():
        pytest.skip('SVDM_DATA names no folder with kitti_odometry_seq1')
    left, right = (cv2.imread(str(folder / side / '000025.png'), cv2.IMREAD_GRAYSCALE) for side in ('left', 'right'))
    infos = [camera_info(side, left.shape[1], left.shape[0]) for side in ('left', 'right')]
    parameters = NodeParameters().replace({'downscale': 2, 'num_disparities': 64})
    sky, road = np.s_[:50, 260:330], np.s_[-40:, 250:400]

    def shares(**values):
        """Of the sky, and of the road, that has a depth."""
        frame = StereoFrame(mono(left), mono(right), *infos, 0.0)
        found = FrameProcessor().process(frame, parameters.replace(values)).frame
        assert found.known.all()
        return [np.isfinite(found.depth[part]).mean() for part in (sky, road)]

    of_sky, of_road = shares()
    assert of_sky < 0.15 and of_road > 0.98
    assert min(shares(confidence_threshold=0.0)) > 0.98
