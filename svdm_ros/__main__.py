"""`python -m svdm_ros`: the node as a process, which a signal ends quietly from its first moment on."""
from __future__ import annotations

import sys

from svdm_core.missing_modules import missing_line

from .node.end_signals import EndSignals


def main() -> int:
    """Entry point; returns the exit code: 0 after SIGINT, SIGTERM or --help, 2 for a setting that is wrong
    or a package that is missing."""
    signals = EndSignals()
    try:
        from .node.process import run  # takes a second, as rclpy, numba and OpenCV come with it
    except ImportError as error:
        print(f'disparity_node: {missing_line(error)}', file=sys.stderr)
        return 2

    return run(signals)


if __name__ == '__main__':
    sys.exit(main())
