"""Ctrl-C of the command `svdm`: a quiet end with 130, wherever it comes. Imports nothing that takes time."""
from __future__ import annotations

import os
import signal
import sys
from types import FrameType

INTERRUPTED = 130  # as a shell reports Ctrl-C
_DEAF = ('importlib', '_frozen_importlib', '_frozen_importlib_external', 'numba', 'llvmlite')
"""Packages that an exception must not be raised in: an import ends in a traceback, a callback of LLVM prints one and
the compilation goes on."""
_SHOW_CURSOR = '\x1b[?25h'


def end_quietly() -> None:
    """Let Ctrl-C end this process with INTERRUPTED, wherever it comes; a process that ignores Ctrl-C goes on doing so.

    For the entry point of a command: it decides about the whole process.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, _on_interrupt)


def _on_interrupt(_number: int, frame: FrameType | None) -> None:
    """Raise KeyboardInterrupt, so that all is tidied up; end at once where it would not get through.

    Nothing is lost by that: numba writes each file of its cache under another name first.
    """
    while frame is not None:
        if frame.f_globals.get('__name__', '').partition('.')[0] in _DEAF:
            if sys.stderr is not None and sys.stderr.isatty():
                os.write(sys.stderr.fileno(), _SHOW_CURSOR.encode())  # a progress bar may have hidden it
            os._exit(INTERRUPTED)
        frame = frame.f_back
    raise KeyboardInterrupt
