"""What a confidence means: the chance that a disparity is wrong."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any, overload

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from .kernels.arrays import Float32

SLOPE, OFFSET = 4.43, 0.65
"""a and b of the chance 1 / (1 + exp(a c - b)) of being off by more than 1 px."""


@overload
def chance_wrong(confidence: float) -> float: ...
@overload
def chance_wrong(confidence: NDArray[Any]) -> Float32: ...


def chance_wrong(confidence: float | NDArray[Any]) -> float | Float32:
    """The chance, 0 .. 1, that a disparity is off by more than 1 px of the images matched: 1 / (1 + exp(a c - b)).

    confidence: c, 0 .. 1, of `DisparityResult`; a number gives a number, an array float32 of its shape. A confidence of
    0 has a chance of 0.66, 1 of 0.02: never 0 and never 1.

    Over many pixels: of those with a chance of 0.1, one in ten is wrong. a and b are fitted by `svdm evaluate FOLDER
    --fit-confidence` to all pixels with known ground truth of the 15 training pairs of Middlebury v3 at quarter
    resolution, preset `default`, in colour, rows as they are. They serve for `accurate`, `fast`, grey images and
    aligned rows as well; not for `paper` and `paper_start`, which measure no margin. Where scenes or cameras differ
    much, repeat the fit. It does not know of rows that are not aligned, of reflections, and too little of what only the
    left camera sees.

    Raises ValueError where a confidence is not within 0 .. 1.
    """
    if np.ndim(confidence) == 0:
        return float(chance_wrong(np.array([confidence]))[0])
    values = np.asarray(confidence, np.float32)
    if values.size:
        low, high = float(values.min()), float(values.max())
        if not (low >= 0 and high <= 1):  # nor is it what is not a number
            raise ValueError(f'confidence from {low:g} to {high:g} is not allowed: it must be within 0 .. 1')
    return np.reciprocal(1 + np.exp(SLOPE * values - OFFSET), dtype=np.float32)
