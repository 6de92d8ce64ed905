"""What a pair takes in memory, compared with what is free before anything is allocated."""
from __future__ import annotations

import cv2

from .cost_aggregation import stripe_trees
from .disparity_optimization import semiglobal
from .exact_route import exact_bytes, is_exact
from .kernels.stripes import rows_of
from .kernels.wide import lanes_for, width_of
from .parameters import MatcherParameters
from .runtime.free_memory import free_memory
from .shown import cut
from .stripe_route import right_aggregation

_PIXEL = 76
"""Bytes a pixel, of either route: planes, edges, winners, maps of stage 4, what comes out."""

_CHANNEL = 16
"""The same for each channel."""

_ALIGNMENT = 40
"""Bytes a pixel where rows are aligned: the map, the field that it is made from, and the image of 16 bit and colour."""

_TREES = 44
"""Bytes a pixel of a view with trees by stripes."""


class NotEnoughMemoryError(MemoryError):
    """A pair needs more memory than is free: nothing was allocated."""


def is_out_of_memory(error: BaseException) -> bool:
    """Whether it was raised as memory could not be had: by Python, numpy, or OpenCV, which has an error of its own."""
    return isinstance(error, MemoryError) or (isinstance(error, cv2.error) and error.code == cv2.Error.StsNoMem)


def lacking_text(error: BaseException) -> str:
    """What an error for which `is_out_of_memory` holds says, in one line."""
    text = error.err if isinstance(error, cv2.error) else str(error)
    return cut(text) or 'the memory is used up'  # no text where another process took it meanwhile


def needed_bytes(
    shape: tuple[int, ...], parameters: MatcherParameters, threads: int, is_aligned: bool = False
) -> int:
    """About what a matcher takes for images of `shape`, (H, W) or (H, W, 3), beside the images. is_aligned: whether the
    rows of the right one are aligned."""
    pixels, channels = shape[0] * shape[1], 1 if len(shape) == 2 else shape[2]
    common = pixels * (_PIXEL + _CHANNEL * channels + _ALIGNMENT * is_aligned)
    if is_exact(parameters):
        return common + exact_bytes(pixels, parameters, threads)
    lanes = width_of(lanes_for(parameters.num_disparities))
    scratch = semiglobal.scratch_size(shape[1], lanes, parameters.paths)
    volumes = 0
    for kind, every in ((parameters.aggregation, 1), (right_aggregation(parameters, channels), parameters.right_rows)):
        if kind == 'tree':
            rows = rows_of(shape, every)
            volumes += rows.height * rows.width * (lanes + _TREES)
            scratch = max(scratch, stripe_trees.scratch_size(rows))
    return common + volumes + threads * scratch


def check_memory(
    shape: tuple[int, ...], parameters: MatcherParameters, threads: int, is_aligned: bool, held: int = 0
) -> int:
    """`needed_bytes`. held: what the last pair took, which is given back first.

    Raises NotEnoughMemoryError where that is more than is free.
    """
    needed, free = needed_bytes(shape, parameters, threads, is_aligned), free_memory()
    if free is not None and needed > free + held:
        raise NotEnoughMemoryError(
            f'{shape[1]}x{shape[0]} px with {parameters.num_disparities} disparities need about '
            f'{in_gigabytes(needed)}, and {in_gigabytes(free + held)} are free')
    return needed


def in_gigabytes(size: float) -> str:
    return f'{size / 1e9:.1f} GB'
