"""Freed memory stays with the process, so that a frame does not ask the system for its intermediate images anew.

glibc hands large blocks back as soon as they are free; each page of them is then zeroed and mapped again for the next
frame: 3500 page faults, a tenth of the time, for `fast` at 1226x370 px.
"""
from __future__ import annotations

import ctypes

# The largest block from which glibc learns, 32 MB on 64 bits, with its own bookkeeping.
_LARGEST = 32 * 2**20 - 2**13


def keep_freed_memory() -> None:
    """Raise glibc's thresholds by freeing a large block, which is never touched.

    From then on blocks of less than this size are reused, and up to twice as much is kept. Where the program or
    MALLOC_... in the environment has set these thresholds, they stay as they are. With another C library than glibc it
    does nothing.
    """
    library = ctypes.CDLL(None)
    library.malloc.argtypes, library.malloc.restype = [ctypes.c_size_t], ctypes.c_void_p
    library.free.argtypes, library.free.restype = [ctypes.c_void_p], None
    library.free(library.malloc(_LARGEST))
