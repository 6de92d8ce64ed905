"""What takes in images works where there is no ROS: messages are told by their fields."""
import subprocess
import sys

import pytest


@pytest.mark.parametrize('module', [
    'calibration.rectification', 'frames.compressed', 'frames.side_by_side', 'frames.image_conversion',
    'frames.row_offsets'])
def test_no_message_package_is_imported(module):
    code = f'import sys, svdm_ros.{module}; print(*sys.modules)'
    loaded = subprocess.run([sys.executable, '-c', code], capture_output=True, text=True, check=True).stdout.split()
    assert f'svdm_ros.{module}' in loaded
    assert not {name.partition('.')[0] for name in loaded} & {'rclpy', 'sensor_msgs', 'stereo_msgs', 'rosbags'}
