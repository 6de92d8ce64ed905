"""Stage 4, first half, by rows: left-right check (eq 15), uniqueness, and filling along scanlines (eq 16)."""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Bool, Int16, Int32, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.stripes import BLOCK
from ..kernels.tasks import share


class Checked(NamedTuple):
    """left: int16 (H, W), disparity - min_disparity; right: int16 (rows, W), mirrored, row y // every stands for row y.

    margin: uint8 (H, W), of `RowWinners`, or (0, 0); least: of it that a valid pixel has. valid: bool (H, W), where
    they agree. filled: int16 (H, W), the left ones, invalid pixels filled. runs: int32 (H, W + 2), of each row how many
    runs of invalid pixels there are, then first pixel and end of each; or (1, 0) where they are not wanted.
    """

    left: Int16
    right: Int16
    every: int
    min_disparity: int
    tau_lr: np.float32
    margin: Uint8
    least: np.uint8
    valid: Bool
    filled: Int16
    runs: Int32


@kernel
def check_and_fill(counter: Int64, end: int, arenas: Uint8, checked: Checked) -> None:
    """Blocks of BLOCK rows."""
    share(_check_rows, counter, end, arenas, (checked,))


@kernel
def _check_rows(task: int, _arena: Uint8, checked: Checked) -> None:
    for y in range(task * BLOCK, min(checked.left.shape[0], (task + 1) * BLOCK)):
        right = checked.right[min(y // checked.every, checked.right.shape[0] - 1)]
        _check_row(checked.left[y], right, checked.min_disparity, checked.tau_lr, checked.valid[y])
        if checked.least > 0 and checked.margin.size > 0:
            _check_margins(checked.margin[y], checked.least, checked.valid[y])
        row = min(y, checked.runs.shape[0] - 1)  # the last one stays empty where runs are not wanted
        _fill_row(checked.left[y], checked.valid[y], checked.filled[y], checked.runs[row])


@kernel
def _check_row(left: Int16, right: Int16, min_disparity: int, tau_lr: np.float32, valid: Bool) -> None:
    """|d_L(p) - d_R(p - d_L(p))| <= tau_lr, with p - d_L(p) inside the image."""
    width = left.size
    for x in range(width):
        d = np.int64(left[x])
        partner = width - 1 - x + d + min_disparity
        inside = 0 <= partner < width
        other = np.int64(right[partner if inside else 0])
        valid[x] = inside and np.float32(abs(d - other)) <= tau_lr


@kernel
def _check_margins(margin: Uint8, least: np.uint8, valid: Bool) -> None:
    for x in range(valid.size):
        valid[x] = valid[x] and margin[x] >= least


@kernel
def _fill_row(disparity: Int16, valid: Bool, filled: Int16, runs: Int32) -> None:
    """Each invalid pixel gets the smaller of the nearest valid disparities on its row; with one side only that one,
    without any what it has. runs: of `Checked`, or empty."""
    width, count = disparity.size, 0
    before = np.int16(-1)
    x = 0
    while x < width:
        if valid[x]:
            before = disparity[x]
            filled[x] = before
            x += 1
            continue
        end = x
        while end < width and not valid[end]:
            end += 1
        after = disparity[end] if end < width else before
        value = after if before < 0 else min(before, after)
        for k in range(x, end):
            filled[k] = value if value >= 0 else disparity[k]
        if runs.size > 0:
            runs[1 + 2 * count], runs[2 + 2 * count] = x, end
            count += 1
        x = end
    if runs.size > 0:
        runs[0] = count


def fill_along_scanlines(disparity: Int16, valid: Bool) -> Int16:
    """Eq 16: a copy of int16 (H, W) in which invalid pixels get the smaller of the nearest valid values on their row.

    valid: bool (H, W). A row without a valid pixel stays as it is. Raises ValueError where a valid value is below 0.
    """
    if disparity.shape != valid.shape or disparity.dtype != np.int16:
        raise ValueError(f'disparity {disparity.shape} {disparity.dtype} and valid {valid.shape} are not allowed: '
                         'they must have the same shape, and disparity must be int16')
    if (disparity[valid] < 0).any():
        raise ValueError('a valid value below 0 is not allowed: values count from min_disparity up')
    filled = np.empty(disparity.shape, np.int16)
    _fill_map(np.ascontiguousarray(disparity), np.ascontiguousarray(valid), filled)
    return filled


@kernel
def _fill_map(disparity: Int16, valid: Bool, filled: Int16) -> None:
    unwanted = np.zeros(0, np.int32)
    for y in range(disparity.shape[0]):
        _fill_row(disparity[y], valid[y], filled[y], unwanted)
