"""Stage 4: disparities for the pixels that failed the left-right check (eq 16)."""
from __future__ import annotations

import numba
import numpy as np

from ..kernels.arrays import Bool, Int32
from ..kernels.compilation import kernel


def fill_along_scanlines(disparity: Int32, valid: Bool) -> Int32:
    """Give each invalid pixel the smaller of the nearest valid disparities left and right on its row (eq 16).

    With a valid pixel on one side only it takes that side; a row without any keeps what it has.
    disparity: int32 (H, W); valid: bool (H, W). Returns int32 (H, W).
    """
    filled = disparity.copy()
    _fill(filled, valid)
    return filled


@kernel(parallel=True)
def _fill(disparity: Int32, valid: Bool) -> None:
    height, width = disparity.shape
    for y in numba.prange(height):
        row, known = disparity[y], valid[y]
        before = np.int32(-1)
        x = 0
        while x < width:
            if known[x]:
                before = row[x]
                x += 1
                continue
            end = x
            while end < width and not known[end]:
                end += 1
            after = row[end] if end < width else before
            value = after if before < 0 else min(before, after)
            if value >= 0:
                row[x:end] = value
            x = end
