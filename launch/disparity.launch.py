"""Start disparity_node on a stereo camera: `ros2 launch svdm_ros disparity.launch.py --show-args` tells the rest."""
from launch import LaunchContext, LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction, SetEnvironmentVariable
from launch.substitutions import EnvironmentVariable, LaunchConfiguration, PathJoinSubstitution
from launch_ros.actions import Node
from launch_ros.substitutions import FindPackageShare

PROFILES_FILE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
CAMERA_TOPICS = ('image_rect', 'camera_info')


def disparity_node(context: LaunchContext) -> list[Node]:
    """The node. Arguments left empty are not handed on, so that the parameter file decides."""
    def value(name: str) -> str:
        return LaunchConfiguration(name).perform(context)

    readings = {'use_sim_time': lambda text: text.lower() == 'true', 'approximate_sync_tolerance': float}
    overrides = {name: read(value(name)) for name, read in readings.items() if value(name)}
    return [Node(
        package='svdm_ros',
        executable='disparity_node',
        name='disparity_node',
        namespace=value('namespace'),
        output='screen',
        parameters=[value('params_file'), *([overrides] if overrides else [])],
        remappings=[
            (f'{side}/{topic}', f'{value(f"{side}_namespace")}/{topic}')
            for side in ('left', 'right') for topic in CAMERA_TOPICS
        ],
    )]


def generate_launch_description() -> LaunchDescription:
    """Arguments, the Fast DDS profile for image-sized messages unless one is set already, and the node."""
    config = PathJoinSubstitution([FindPackageShare('svdm_ros'), 'config'])
    arguments = {
        'namespace': ('', 'namespace of the node and of its relative topics'),
        'left_namespace': ('left', 'where image_rect and camera_info of the left camera are'),
        'right_namespace': ('right', 'where image_rect and camera_info of the right camera are'),
        'params_file': (PathJoinSubstitution([config, 'default.yaml']), 'ROS parameter file, e.g. one of the presets'),
        'approximate_sync_tolerance': ('', 'largest stamp difference of a pair in s; empty: as params_file has it'),
        'use_sim_time': ('', 'true: take the time from /clock; empty: as params_file has it'),
    }
    profile = EnvironmentVariable(PROFILES_FILE, default_value=PathJoinSubstitution([config, 'fastdds.xml']))
    return LaunchDescription([
        *(DeclareLaunchArgument(name, default_value=default, description=description)
          for name, (default, description) in arguments.items()),
        SetEnvironmentVariable(PROFILES_FILE, profile),
        OpaqueFunction(function=disparity_node),
    ])
