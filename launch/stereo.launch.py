"""Start disparity_node and RViz: `ros2 launch svdm_ros stereo.launch.py --show-args` tells the arguments."""
from launch import LaunchDescription

from svdm_ros.launching import (
    CAMERA_ARGUMENTS,
    NODE_ARGUMENTS,
    RVIZ_ARGUMENTS,
    disparity_node,
    launch_description,
    rviz,
)


def generate_launch_description() -> LaunchDescription:
    """The node, and RViz where it is installed."""
    return launch_description(
        __file__, {**CAMERA_ARGUMENTS, **NODE_ARGUMENTS, **RVIZ_ARGUMENTS},
        lambda given: [disparity_node(given), *rviz(given)])
