"""An example: one disparity_node per stereo camera, each in the namespace of its camera.

`ros2 launch svdm_ros two_cameras.launch.py cameras:=front,rear` subscribes to /front/left/image_rect and so on, and
publishes /front/disparity and so on.
"""
from launch import LaunchDescription

from svdm_ros.launching import CAMERA_ARGUMENTS, NODE_ARGUMENTS, disparity_node, launch_description

CAMERAS = {'cameras': ('front,rear', 'namespaces of the cameras, with commas between them')}
"""The topics below each namespace are those of one camera."""


def generate_launch_description() -> LaunchDescription:
    """The nodes."""
    one_camera = {name: default for name, (default, _) in CAMERA_ARGUMENTS.items()}
    return launch_description(
        __file__, {**CAMERAS, **NODE_ARGUMENTS},
        lambda given: [disparity_node({**one_camera, **given, 'namespace': name.strip()})
                       for name in given['cameras'].split(',')])
