"""What the commands that write recordings share: progress, and how they end."""
from __future__ import annotations

import contextlib
import signal
import sys
from collections.abc import Callable, Iterator
from types import FrameType

from svdm_core.missing_modules import missing_line
from svdm_core.shown import cut, line

REFUSED, INTERRUPTED = 2, 130


@contextlib.contextmanager
def progress(what: str, total: int) -> Iterator[Callable[[], None]]:
    """A bar with rate and time left on a terminal; yields what moves it on by one."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn('{task.description}', markup=False), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    console = Console(stderr=True)
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        task = bar.add_task(cut(what), total=total)
        yield lambda: bar.advance(task)


def ending(command: str, run: Callable[[], int]) -> int:
    """Run a command; its exit code, or 2 after one line that says what was wrong, or 130 after SIGINT or SIGTERM."""
    signal.signal(signal.SIGTERM, _interrupt)
    try:
        return run()
    except OSError as error:
        print(f'{command}: {line(f"{error.filename or 'output'}: {error.strerror or error}")}', file=sys.stderr)
    except ValueError as error:
        print(f'{command}: {line(error)}', file=sys.stderr)
    except ImportError as error:
        print(f'{command}: {missing_line(error)}', file=sys.stderr)
    except KeyboardInterrupt:
        print(f'{command}: interrupted, nothing was written', file=sys.stderr)
        return INTERRUPTED
    return REFUSED


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt
