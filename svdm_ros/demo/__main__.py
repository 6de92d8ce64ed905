"""`python -m svdm_ros.demo`: see the node work on a real stereo pair."""
from __future__ import annotations

import argparse
import importlib.util
import signal
import sys
from pathlib import Path
from types import FrameType

from svdm_core.commands.argument_types import count, positive
from svdm_core.missing_modules import not_installed
from svdm_core.runtime import configure

from ..processes.children import RunError

NEEDED = ('rclpy', 'stereo_msgs', 'skimage', 'matplotlib', 'rich')
INTERRUPTED = 130  # as a shell reports Ctrl-C


def main() -> int:
    """Entry point; returns the exit code: 0, 1 with one line that says what went wrong, 130 when interrupted."""
    arguments = _parse()
    signal.signal(signal.SIGTERM, _interrupt)
    configure()
    try:
        _check_installed()
        from .run import Settings, run_demo  # needs what was checked

        run_demo(Settings(arguments.output, arguments.frames, arguments.rate))
    except RunError as error:
        print(f'demo: {error}', file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print('demo: interrupted, all processes ended', file=sys.stderr)
        return INTERRUPTED
    return 0


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='svdm_demo', description=__doc__)
    parser.add_argument('--output', type=Path, default=Path('demo_output'), help='folder for pictures and summary')
    parser.add_argument('--frames', type=count, default=20, help='disparity images of each phase')
    parser.add_argument('--rate', type=positive, default=10.0, help='stereo pairs sent a second')
    return parser.parse_args()


def _check_installed() -> None:
    missing = [module for module in NEEDED if importlib.util.find_spec(module) is None]
    if missing:
        raise RunError(f'{not_installed(missing)}; or run `make demo`, which needs none of them')


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


if __name__ == '__main__':
    sys.exit(main())
