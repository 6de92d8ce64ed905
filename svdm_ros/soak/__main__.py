"""The node for minutes or hours among hostile messages, requests and pauses: python -m svdm_ros.soak --minutes 10.

Good pairs are sent all the while; in between come messages of any content and bytes that are no messages, requests to
change parameters in and out of range, jumps of time, new cameras, and a node and a camera that are stopped for a while.
Answers are compared with those made offline. Exit code 0 where all is well, 1 where not.
"""
from __future__ import annotations

import argparse
import sys

from svdm_core.commands.argument_types import positive

from ..node.end_signals import EndSignals
from ..processes.children import RunError

INTERRUPTED = 130  # as a shell reports Ctrl-C
_FAULTS_SHOWN = 5
"""Of each kind."""


def main(arguments: list[str] | None = None) -> int:
    """Entry of the command: 0, 1 where something was wrong, 2 for an argument that is not allowed, 130 when
    interrupted."""
    signals = EndSignals(INTERRUPTED)
    options = _parse(arguments)
    from rich.console import Console
    from rich.table import Table

    from .run import Settings, soaking  # takes a second, as rclpy comes with it
    from .tally import COLUMNS, rows, verdict

    def check() -> None:
        if signals.received:
            raise KeyboardInterrupt

    signals.end_in_order()  # from here on there are children to be ended first
    code = 0
    with soaking(Settings(60 * options.minutes, options.seed, options.rate, options.hostile, options.requests),
                 check) as soak:
        try:
            soak.run()
        except RunError as error:
            soak.tally.fault('ended early', str(error))
        except KeyboardInterrupt:
            code = INTERRUPTED
    table = Table(*COLUMNS, title=f'seed {options.seed}, {options.rate:g} pairs a second')
    for row in rows(soak.tally):
        table.add_row(*row)
    Console(width=110).print(table)
    for kind, texts in soak.tally.faults.items():
        print(f'soak: {kind}, {len(texts)} times:', *texts[:_FAULTS_SHOWN], sep='\n    ', file=sys.stderr)
    print(verdict(soak.tally))
    return code or (0 if soak.tally.is_well else 1)


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='soak', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--minutes', type=positive, default=10.0, metavar='M', help='how long (10)')
    parser.add_argument('--seed', type=int, default=0, metavar='N', help='of everything that is chance (0)')
    parser.add_argument('--rate', type=positive, default=20.0, metavar='HZ', help='pairs sent a second (20)')
    parser.add_argument('--hostile', type=int, default=2, metavar='N', help='hostile messages after each pair (2)')
    parser.add_argument('--requests', type=int, default=200, metavar='N',
                        help='requests to change parameters, in each round of about ten seconds (200)')
    return parser.parse_args(arguments)


if __name__ == '__main__':
    sys.exit(main())
