"""The row alignment of a camera from one or many of its pairs."""
from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Image, Uint8
from .alignment import RowAlignment, RowPoints
from .fitting import fit_rows, guess_rows, pooled
from .measurement import MOST_CORNERS, grey_of, measured

_ROUNDS = 3
"""The vertex of a parabola is drawn to whole rows: what is left of an offset after resampling is measured better."""


class GreyPair(NamedTuple):
    left: Uint8
    right: Uint8


def estimate_row_alignment(
    pairs: Iterable[tuple[Image, Image]] | tuple[Image, Image], min_disparity: int, num_disparities: int,
) -> RowAlignment | None:
    """The row alignment of one pair, or of several of the same cameras; None where none can be told.

    pairs: (left, right), uint8 or uint16, grey or BGR, all of one size. The search range is min_disparity ..
    min_disparity + num_disparities - 1, px. None where few points are found, where they are in a part of the image only
    and where the field would not make the offsets significantly smaller, as in pairs whose rows are aligned. The same
    images give the same alignment. Raises ValueError where sizes differ.
    """
    grey = grey_pairs(pairs)
    return estimate_grey(grey, (min_disparity, min_disparity + num_disparities - 1)) if grey else None


def estimate_grey(grey: Sequence[GreyPair], search: tuple[int, int]) -> RowAlignment | None:
    """`estimate_row_alignment` of one grey pair or more; search: smallest and largest disparity."""
    shape = grey[0].left.shape
    found: RowAlignment | None = None
    for _ in range(_ROUNDS - 1):
        found = guess_rows(pooled([off_by(found, pair, search) for pair in grey]), shape, found)
        if found is None:
            return None
    return fit_rows([off_by(found, pair, search) for pair in grey], shape, found)


def off_by(
    known: RowAlignment | None, pair: tuple[Uint8, Uint8], search: tuple[int, int], most: int = MOST_CORNERS,
) -> RowPoints:
    """Offsets of a grey pair: measured after it was aligned by what is known, and added to that."""
    if known is None:
        return measured(*pair, search, most)
    left, right = pair
    points = measured(left, known.apply(right), search, most)
    return points._replace(dy=points.dy + known.offsets(points.x_right, points.y))


def grey_pairs(pairs: Iterable[tuple[Image, Image]] | tuple[Image, Image]) -> list[GreyPair]:
    """One pair or several. Raises ValueError where they are not all of one size."""
    if isinstance(pairs, tuple) and len(pairs) == 2 and all(isinstance(image, np.ndarray) for image in pairs):
        pairs = [pairs]  # type: ignore[list-item]
    grey: list[GreyPair] = []
    for left, right in pairs:
        pair = GreyPair(grey_of(left), grey_of(right))
        grey.append(pair)
        sizes = {image.shape: f'{image.shape[1]} x {image.shape[0]}' for image in (*pair, grey[0].left)}
        if len(sizes) > 1:
            raise ValueError(f'images of {" and ".join(sizes.values())} px: all must have the same size')
    return grey
