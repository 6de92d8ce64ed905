"""How fast the node is: a camera, the node and a listener as processes of their own on this machine, over DDS.

python -m svdm_ros.benchmark [--size 640x480] [--rate 30] [--seconds 15] [--preset fast] [--json FILE]

A signal ends it quietly from its first moment on.
"""
from __future__ import annotations

import sys

from ..node.end_signals import EndSignals

INTERRUPTED = 130  # as a shell reports Ctrl-C


def main(arguments: list[str] | None = None) -> int:
    """Entry of the command: 0, 1 or 2 with one line that says what went wrong or is not allowed, 130 when interrupted.
    """
    signals = EndSignals(INTERRUPTED)
    try:
        from .node_benchmark import run  # takes a second, as numpy and rclpy come with it
    except ImportError as error:
        from svdm_core.missing_modules import missing_line

        print(f'node_benchmark: {missing_line(error)}', file=sys.stderr)
        return 2
    return run(signals, arguments)


if __name__ == '__main__':
    sys.exit(main())
