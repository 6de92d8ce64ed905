"""What the node answers on its command line without being started: its usage, and what it does not know."""
from __future__ import annotations

import itertools
import sys
from collections.abc import Sequence
from pathlib import Path

from svdm_core.files.user_files import SETTINGS, check_regular
from svdm_core.shown import shown

_USAGE = '''usage: disparity_node [--help] [--ros-args [-r FROM:=TO] [-p NAME:=VALUE] [--params-file FILE] ...]

Pairs two images, matches them, and publishes what somebody listens to. Runs until Ctrl-C.

in:   left/image_rect, right/image_rect      sensor_msgs/Image; with input raw left|right/image_raw, with transport
                                             compressed <topic>/compressed, with layout side_by_side one image_rect|raw
      left/camera_info, right/camera_info    sensor_msgs/CameraInfo
{outputs}
      /diagnostics                           diagnostic_msgs/DiagnosticArray, once a second

  -r left/image_rect:=/cam/left/image_rect   take a topic under another name
  -p num_disparities:=96                     set a parameter; those of a file: --params-file FILE

All parameters can be changed while the node runs:
  ros2 param list /disparity_node            which there are
  ros2 param describe /disparity_node alpha  what one means, and what is allowed
  ros2 param set /disparity_node alpha 8.0   change it
'''


def usage() -> str:
    """What --help prints; the outputs are those of OUTPUTS."""
    from ..frames.outputs import OUTPUTS  # takes a moment, as numpy and OpenCV come with it

    rows = [f'{output.topic:<39}{output.message_type.replace("/msg", ""):<28}{output.meaning}' for output in OUTPUTS]
    return _USAGE.format(outputs='out:  ' + '\n      '.join(rows))


def check_parameter_files(arguments: Sequence[str]) -> None:
    """Raise RefusedFileError where a --params-file is none that can be read to its end: rcl would wait for ever."""
    for flag, name in itertools.pairwise(arguments):
        if flag == '--params-file' and Path(name).exists():  # what is missing, rcl says itself
            check_regular(Path(name), SETTINGS)


def answer(arguments: Sequence[str]) -> int | None:
    """The exit code where `arguments` (those that are not for ROS) are answered by a text; None: start the node."""
    if not arguments:
        return None
    if any(argument in ('-h', '--help') for argument in arguments):
        print(usage(), end='')
        return 0
    print(f'disparity_node: unknown argument {shown(arguments[0])}: topics and parameters are set behind '
          '--ros-args, as in --ros-args -p num_disparities:=96 (--help tells more)', file=sys.stderr)
    return 2
