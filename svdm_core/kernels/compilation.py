"""How kernels are compiled: one decorator, so that all of them have the same target, options and cache."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any, cast, overload

import numba

from .cache_files import kernel_cache

_SETTINGS: Any = numba.config  # comes without types

THREADS: int = _SETTINGS.NUMBA_NUM_THREADS
"""The most that run a parallel kernel: one for each core, or what NUMBA_NUM_THREADS in the environment says.

numba starts them when the first parallel kernel is called, and earlier where it is asked for their number.
"""


@overload
def kernel[Function: Callable[..., Any]](function: Function, /) -> Function: ...


@overload
def kernel[Function: Callable[..., Any]](*, inline: bool = False) -> Callable[[Function], Function]: ...


def kernel(function: Callable[..., Any] | None = None, /, *, inline: bool = False) -> Any:
    """The function is compiled at its first call with arguments of new types, or loaded from the cache.

    It runs without the GIL; on all threads what it shares by `tasks.share`. LLVM decides what is inlined, but for what
    is `inline`: part of each kernel that calls it.
    """
    def decorate[Function: Callable[..., Any]](function: Function) -> Function:
        dispatcher: Any = numba.njit(nogil=True, inline='always' if inline else 'never')(function)
        dispatcher._cache = kernel_cache(function)  # numba's own cache loads whatever it finds
        return cast(Function, dispatcher)

    return decorate if function is None else decorate(function)
