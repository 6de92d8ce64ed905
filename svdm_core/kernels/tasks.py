"""Tasks that all threads draw from: which thread does which is chance, what comes out is not."""
from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic

_CACHE_LINE = 64  # bytes


@intrinsic
def _take(_: Any, counter: Any) -> Any:
    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        place = context.make_array(signature.args[0])(context, builder, arguments[0]).data
        return builder.atomic_rmw('add', place, ir.Constant(ir.IntType(64), 1), 'monotonic')

    return types.int64(counter), generate


take: Any = _take
"""take(counter), in kernels: the number of the next task, each given out once; counter: int64 (1)."""


def whole_lines(size: int) -> int:
    """`size` in bytes, rounded up so that what comes behind it begins with a cache line."""
    return -(-size // _CACHE_LINE) * _CACHE_LINE
