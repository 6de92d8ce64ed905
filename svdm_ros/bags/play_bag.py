"""`play_bag`: a recording published as it was taken. `python -m svdm_ros.bags.play_bag`."""
from __future__ import annotations

import argparse
import sys
from pathlib import Path

from svdm_core.commands.argument_types import count, not_negative, positive
from svdm_core.missing_modules import missing_line

from ..node.end_signals import EndSignals

_CLOCK_HZ = 40.0
_ENDLESS = 0


def main() -> int:
    """Entry point; returns the exit code: 0 (after SIGINT and SIGTERM too), 1 where the recording breaks off, or 2 with
    one line that says what was wrong.
    """
    EndSignals()  # until rclpy is there, a signal ends it at once
    options, ros_arguments = _parse(sys.argv[1:])
    try:
        from .play.playback import play  # takes a second, as rclpy comes with it
    except ImportError as error:
        print(f'play_bag: {missing_line(error)}', file=sys.stderr)
        return 2
    return play(options, ros_arguments)


def _parse(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """The options, and what follows --ros-args (remappings)."""
    at = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    return _parser().parse_args(arguments[:at]), arguments[at:]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='play_bag', description='Publish a recording (rosbag2 or ROS 1) with its own timing and QoS.',
        epilog='Topics are remapped with --ros-args -r OLD:=NEW, behind all other arguments.')
    parser.add_argument('bag', type=Path, metavar='BAG', help='.mcap, .db3, .bag, or the folder of a rosbag2')
    parser.add_argument('--rate', type=positive, default=1.0, metavar='R', help='times as fast as recorded (1)')
    parser.add_argument('--loop', type=count, nargs='?', const=_ENDLESS, default=1, metavar='N',
                        help='play N times, without N until interrupted; the stamps stay those of the recording')
    parser.add_argument('--clock', type=positive, nargs='?', const=_CLOCK_HZ, metavar='HZ',
                        help=f'publish the time of the recording on /clock, for use_sim_time ({_CLOCK_HZ:g} Hz)')
    parser.add_argument('--start', type=not_negative, default=0.0, metavar='S', help='begin S seconds in (0)')
    parser.add_argument('--duration', type=positive, metavar='S', help='play S seconds of it')
    parser.add_argument('--topics', nargs='+', default=[], metavar='TOPIC', help='these only')
    parser.add_argument('--wait-for-subscribers', action='store_true',
                        help='begin when somebody listens, and no more have come for a second')
    return parser


if __name__ == '__main__':
    sys.exit(main())
