"""Start disparity_node on a stereo camera: `ros2 launch svdm_ros disparity.launch.py --show-args` tells the rest."""
from launch import LaunchDescription

from svdm_ros.launching import CAMERA_ARGUMENTS, NODE_ARGUMENTS, disparity_node, launch_description


def generate_launch_description() -> LaunchDescription:
    """The node alone."""
    return launch_description(
        __file__, {**CAMERA_ARGUMENTS, **NODE_ARGUMENTS}, lambda given: [disparity_node(given)])
