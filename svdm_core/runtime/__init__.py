"""This process: its threads, its memory, its processors, Ctrl-C."""
from .memory_reuse import keep_freed_memory
from .thread_waiting import wait_briefly


def configure() -> None:
    """Make this process fit for matching frame after frame: threads wait briefly, freed memory is kept.

    Both concern the whole process, so it is up to the program to call it, before the first frame: later on, threads
    wait as they did. What the environment says about either is left as it is.
    """
    wait_briefly()
    keep_freed_memory()
