"""`process_bag`: the disparity of every stereo pair of a recording, or of many. Needs no ROS."""
from __future__ import annotations

import argparse
import signal
import sys
from pathlib import Path
from types import FrameType

from svdm_core.commands.argument_types import FROM_THE_PAIRS, alignment_file, count, not_negative, positive
from svdm_core.missing_modules import missing_line
from svdm_core.shown import line

_INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> int:
    """Entry point; the exit code: 0 where every pair has its disparity, 1 where something is missing, 2 with one line
    where nothing came out, 130 after SIGINT or SIGTERM.
    """
    options = _parser().parse_args(arguments)
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        from .process.process_command import run  # takes seconds, as numba, OpenCV and rosbags come with it

        return run(options)
    except OSError as error:
        print(line(f'process_bag: {error.filename or options.output}: {error.strerror or error}'), file=sys.stderr)
    except ValueError as error:
        print(f'process_bag: {line(error)}', file=sys.stderr)
    except ImportError as error:
        print(f'process_bag: {missing_line(error)}', file=sys.stderr)
    except KeyboardInterrupt:
        print('process_bag: interrupted; what is done is kept, the same command goes on from there', file=sys.stderr)
        return _INTERRUPTED
    return 2


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='process_bag', description='Write a bag with the disparity of every stereo pair of a recording.',
        epilog='OUTPUT appears under its name when it is complete; until then it is OUTPUT.partial, a readable bag, '
               'from which the same command goes on. With several inputs OUTPUT is a folder for their bags, and those '
               'that are there already are skipped.')
    parser.add_argument('inputs', nargs='+', metavar='INPUT',
                        help='.mcap, .db3, .bag, also with .zstd, or the folder of a rosbag2; or a pattern in quotes')
    parser.add_argument('output', type=Path, metavar='OUTPUT', help='the bag to write, a folder')
    source = parser.add_mutually_exclusive_group()
    source.add_argument('--preset', default='default', metavar='P', help='preset by name, or a .yaml file (default)')
    source.add_argument('--params', type=Path, metavar='FILE', help='parameter file, as ros2 takes it')
    parser.add_argument('--set', nargs='+', action='extend', default=[], dest='changes', metavar='NAME=VALUE',
                        help="change parameters of it, the matcher's and the node's")
    parser.add_argument('--left', metavar='TOPIC',
                        help='left images (found where there is one pair); with layout=side_by_side the one topic')
    parser.add_argument('--right', metavar='TOPIC', help='right images')
    parser.add_argument('--calib', type=Path, action='append', metavar='FILE',
                        help='calibration in place of camera_info, of KITTI, EuRoC, Middlebury v3 or ROS; twice for '
                             'files of one camera each, left first')
    parser.add_argument('--align-rows', nargs='?', type=alignment_file, const=FROM_THE_PAIRS, metavar='FILE',
                        help='align the rows of the right images first, by a .yaml of svdm check-rectification; '
                             'without FILE, by what the recording shows')
    parser.add_argument('--start', type=not_negative, default=0.0, metavar='S', help='begin S seconds in (0)')
    parser.add_argument('--duration', type=positive, metavar='S', help='process S seconds of it')
    parser.add_argument('--copy-inputs', action='store_true', help='copy the images as well, not camera_info only')
    parser.add_argument('--outputs', default='disparity', metavar='NAME,...',
                        help='what is written, as the node has it: disparity, depth, points, confidence, preview '
                             '(disparity)')
    parser.add_argument('--preview', choices=('mp4', 'png'), help='write a film, or a picture a pair, into the bag')
    parser.add_argument('--jobs', type=count, metavar='N',
                        help='recordings at a time, each with its share of the processors (1; with --scheduler one a '
                             'worker)')
    parser.add_argument('--scheduler', metavar='ADDRESS', help='a Dask cluster to run on, tls://host:port or tcp://host:port')
    parser.add_argument('--force', action='store_true', help='replace bags that exist, and begin partial ones anew')
    return parser


if __name__ == '__main__':
    sys.exit(main())
