"""Stage 4, last: the plain median over the finished map, with its sub-pixel parts; borders replicated."""
from __future__ import annotations

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numba.core import types
from numba.extending import intrinsic

from ..kernels.arrays import Float32, Int64, Uint8, Uint16
from ..kernels.compilation import kernel
from ..kernels.stripes import BLOCK
from ..kernels.tasks import share
from ..kernels.vectors import pointer
from ..kernels.wide import UNIT, Wide, least_of, loaded, most_of, store_wide
from .byte_median import STEPS

_LANES = (0,)


def sorting_network(size: int) -> Iterator[tuple[int, int]]:
    """Batcher's odd-even merge sort: pairs of places, the smaller goes to the first; for `size` numbers."""
    distance = 1
    while distance < size:
        step = distance
        while step >= 1:
            for start in range(step % distance, size - step, 2 * step):
                for k in range(min(step, size - start - step)):
                    if (start + k) // (2 * distance) == (start + k + step) // (2 * distance):
                        yield start + k, start + k + step
            step //= 2
        distance *= 2


@intrinsic(prefer_literal=True)
def _window_median(_: Any, elements: Any, index: Any, pitch: Any, side: Any) -> Any:
    """Medians of side x side windows whose first elements lie from `index` on; rows `pitch` apart."""
    wide, across = Wide(elements.dtype, UNIT), side.literal_value

    def generate(context: Any, builder: Any, signature: Any, arguments: Any) -> Any:
        base, start, step, _ = arguments
        values = []
        for _row in range(across):
            values += [loaded(context, builder, base, start, column, wide) for column in range(across)]
            start = builder.add(start, step)
        for low, high in sorting_network(len(values)):
            a, b = values[low], values[high]
            values[low], values[high] = least_of(builder, wide, a, b), most_of(builder, wide, a, b)
        return builder.insert_value(context.get_constant_undef(wide), values[len(values) // 2], 0)

    return wide(elements, types.intp, types.intp, side), generate


window_median: Any = _window_median  # called without the typing context


class SmoothedMap(NamedTuple):
    """Where medians go, each (H, W) or (0, 0) where it is not wanted. fixed: uint16, 1 / STEPS px; disparity: float32,
    px."""

    fixed: Uint16
    disparity: Float32


@kernel
def smooth_map(
    counter: Int64, end: int, arenas: Uint8, fixed: Uint16, side: int, min_disparity: int, smoothed: SmoothedMap
) -> None:
    """Medians of fixed, uint16 (H, W) in 1 / STEPS px; side 1, 3 or 5."""
    share(_smooth_rows, counter, end, arenas, (fixed, side, min_disparity, smoothed))


def scratch_size(width: int) -> int:
    """Bytes of scratch a task takes."""
    return 2 * (BLOCK + 5) * (width + 4 + 2 * UNIT)


@kernel
def _smooth_rows(
    task: int, arena: Uint8, fixed: Uint16, side: int, min_disparity: int, smoothed: SmoothedMap
) -> None:
    scratch = arena.view(np.uint16)
    height, width = fixed.shape
    first, last = task * BLOCK, min(height, (task + 1) * BLOCK)
    r, pitch = side // 2, width + 4 + UNIT
    for k in range(last - first + 2 * r):
        row, to = fixed[min(max(first + k - r, 0), height - 1)], scratch[k * pitch:(k + 1) * pitch]
        to[:r] = row[0]
        to[r:r + width] = row
        to[r + width:] = row[width - 1]
    window = scratch[(last - first + 2 * r) * pitch:]
    for y in range(first, last):
        at = (y - first) * pitch
        _median_row(pointer(scratch), at, pitch, side, width, pointer(window))
        if smoothed.fixed.size > 0:
            smoothed.fixed[y] = window[:width]
        if smoothed.disparity.size > 0:
            for x in range(width):
                smoothed.disparity[y, x] = np.float32(window[x]) * np.float32(1 / STEPS) + np.float32(min_disparity)


@kernel
def _median_row(rows: Uint16, at: int, pitch: int, side: int, width: int, to: Uint16) -> None:
    for x in range(0, width, UNIT):
        if side == 5:
            store_wide(to, x, window_median(rows, at + x, pitch, 5))
        elif side == 3:
            store_wide(to, x, window_median(rows, at + x, pitch, 3))
        else:
            store_wide(to, x, window_median(rows, at + x, pitch, 1))
