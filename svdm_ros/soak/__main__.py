"""The node for minutes or hours among hostile messages, requests and pauses: python -m svdm_ros.soak --minutes 10.

Good pairs are sent all the while; in between come messages of any content and bytes that are no messages, requests to
change parameters in and out of range, jumps of time, new cameras, and a node and a camera that are stopped for a while.
Answers are compared with those made offline. Exit code 0 where all is well, 1 where not.

With --steady nothing comes between the good pairs, and what is judged is whether memory and latency stay as they were
and no pair is lost: python -m svdm_ros.soak --steady --minutes 60 --size 640x480.
"""
from __future__ import annotations

import argparse
import sys

from svdm_core.commands.argument_types import positive, size

from ..node.end_signals import EndSignals
from ..processes.children import RunError

INTERRUPTED = 130  # as a shell reports Ctrl-C
_SMALLEST = 128
"""px, of either side: half of it, with `downscale`, still holds the search range of `fast`."""


def main(arguments: list[str] | None = None) -> int:
    """Entry of the command: 0, 1 where something was wrong, 2 for an argument that is not allowed, 130 when
    interrupted."""
    signals = EndSignals(INTERRUPTED)
    options = _parse(arguments)
    from .report import report  # takes a second, as rclpy comes with it
    from .run import Settings, soaking

    def check() -> None:
        if signals.received:
            raise KeyboardInterrupt

    settings = Settings(60 * options.minutes, options.seed, options.size, options.rate, options.steady, options.hostile,
                        options.requests)
    signals.end_in_order()  # from here on there are children to be ended first
    code = 0
    with soaking(settings, check) as soak:
        try:
            soak.run()
        except RunError as error:
            soak.tally.fault('ended early', str(error))
        except KeyboardInterrupt:
            code = INTERRUPTED
    is_well = report(soak.tally, settings)
    return code or (0 if is_well else 1)


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='soak', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--minutes', type=positive, default=10.0, metavar='M', help='how long (10)')
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='of everything that is chance (0)')
    parser.add_argument('--size', type=_size, default=(320, 240), metavar='WxH', help='of the good pairs, px (320x240)')
    parser.add_argument('--rate', type=positive, default=20.0, metavar='HZ', help='pairs sent a second (20)')
    parser.add_argument('--steady', action='store_true',
                        help='let nothing disturb the node (--hostile and --requests do not count), and judge its '
                             'memory, losses and latency')
    parser.add_argument('--hostile', type=int, default=2, metavar='N', help='hostile messages after each pair (2)')
    parser.add_argument('--requests', type=int, default=200, metavar='N',
                        help='requests to change parameters, in each round of about ten seconds (200)')
    return parser.parse_args(arguments)


def _size(text: str) -> tuple[int, int]:
    found = size(text)
    if min(found) < _SMALLEST:
        raise argparse.ArgumentTypeError(f'{text!r} is not allowed: both sides must be at least {_SMALLEST} px')
    return found


if __name__ == '__main__':
    sys.exit(main())
