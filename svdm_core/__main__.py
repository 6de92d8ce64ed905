"""`python -m svdm_core`: the command `svdm`, which Ctrl-C ends quietly from its first moment on."""
from __future__ import annotations

import sys

from .runtime import configure
from .runtime.interrupts import end_quietly


def main() -> int:
    """Entry point; returns the exit code, see `commands.cli`."""
    end_quietly()
    configure()
    from .commands import cli  # takes time, as OpenCV comes with it: only now does Ctrl-C end quietly

    return cli.main()


if __name__ == '__main__':
    sys.exit(main())
