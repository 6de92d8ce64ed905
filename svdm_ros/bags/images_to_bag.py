"""`images_to_bag`: image files of a stereo pair and their calibration to a rosbag2. Needs no ROS."""
from __future__ import annotations

import argparse
import sys
from pathlib import Path

from svdm_core.commands.argument_types import positive

from ..command_line.command import ending


def main(arguments: list[str] | None = None) -> int:
    """Entry point; the exit code: 0, 1 where images were left out for want of a partner, 2 with one line, 130."""
    options = _parser().parse_args(arguments)
    return ending('images_to_bag', lambda: _run(options))


def _run(options: argparse.Namespace) -> int:
    from .images.image_bag import run  # takes a second, as OpenCV and rosbags come with it

    return run(options)


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='images_to_bag', description='Write image files of a stereo pair and their calibration as a rosbag2.',
        epilog='Stamps are the file names where they are ns (EuRoC), else the lines of a times.txt or timestamps.txt '
               'beside the images or one folder up (KITTI), else 10 Hz.')
    parser.add_argument('left', type=Path, metavar='LEFT', help='folder of the left images, or one image')
    parser.add_argument('right', type=Path, metavar='RIGHT', help='folder of the right images, or one image')
    parser.add_argument('output', type=Path, metavar='OUTPUT', help='the bag, a folder that does not exist yet')
    parser.add_argument('--calib', type=Path, action='append', required=True, metavar='FILE',
                        help='of KITTI, EuRoC, Middlebury v3 or ROS; twice for files of one camera each, left first')
    parser.add_argument('--rate', type=positive, metavar='HZ', help='pairs a second, in place of the stamps found')
    parser.add_argument('--ground-truth', type=Path, metavar='DIR',
                        help='disparities named like the left images, PNG of KITTI or PFM, for /ground_truth/disparity')
    parser.add_argument('--storage', choices=('mcap', 'sqlite3'), default='mcap', help='kind of file (mcap)')
    parser.add_argument('--compression', choices=('none', 'zstd'), default='none', help='of the file (none)')
    parser.add_argument('--force', action='store_true', help='replace a bag that exists')
    return parser


if __name__ == '__main__':
    sys.exit(main())
