"""The command `svdm`: hands over to one module of `svdm_core.commands`."""
from __future__ import annotations

import argparse
import importlib
import sys

from ..missing_modules import missing_line
from ..runtime.interrupts import INTERRUPTED
from ..shown import line

# Command -> its line in the help; only the module of the command given is imported.
COMMANDS = {
    'match': 'the disparity of one pair as a file, and a picture of it',
    'evaluate': 'svdm and OpenCV over the scenes of Middlebury or KITTI: a table, JSON, an HTML page',
    'check-rectification': 'how far the rows of left and right images are apart, and what to do about it',
    'tune': 'find parameters on images with ground truth, one at a time or jointly',
    'benchmark': 'time the presets beside OpenCV StereoBM and StereoSGBM',
    'warmup': 'compile the kernels into the cache, so that the first frame comes soon',
}


def main(arguments: list[str] | None = None) -> int:
    """Entry point; returns the exit code: 0, 1 with results for a part only, 2 with one line that says what was wrong,
    130 after Ctrl-C.
    """
    given = sys.argv[1:] if arguments is None else arguments
    try:
        return _run(given)
    except KeyboardInterrupt:
        return INTERRUPTED
    except ImportError as error:
        print(f'{" ".join(["svdm", *given[:1]])}: {missing_line(error)}', file=sys.stderr)
        return 2


def _run(arguments: list[str]) -> int:
    import cv2  # may be missing, which is to be one line

    options = _parser(arguments).parse_args(arguments)
    try:
        return int(options.run(options))
    except (ValueError, OSError) as error:
        print(f'svdm {options.command}: {line(error)}', file=sys.stderr)
    except MemoryError as error:
        print(f'svdm {options.command}: out of memory: {line(error)}: take smaller images or fewer num_disparities',
              file=sys.stderr)
    except cv2.error as error:
        print(f'svdm {options.command}: OpenCV refuses it: {line(error)}', file=sys.stderr)
    return 2


def _parser(arguments: list[str]) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog='svdm', description='The stereo matcher of svdm_ros, without ROS.')
    commands = parser.add_subparsers(dest='command', required=True)
    for name, meaning in COMMANDS.items():
        command = commands.add_parser(name, help=meaning, description=meaning)
        if name in arguments[:1]:
            module = importlib.import_module(f'.{name.replace("-", "_")}', __package__)
            module.add_arguments(command)
            command.set_defaults(run=module.run)
    return parser
