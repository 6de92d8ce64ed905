"""Keeps the row alignment of a live camera up to date, look by look."""
from __future__ import annotations

from collections import deque

import numpy as np

from ..kernels.arrays import Image
from .alignment import RowAlignment, RowPoints
from .estimation import off_by
from .fitting import can_tell, fit_rows, is_better, pooled
from .measurement import grey_of

_CORNERS = 200
LOOKS = 12
"""What was measured more looks ago counts no more."""
_CHANGE = 0.03
"""px, root mean square over the image, of a change that is worth making."""


class RowTracker:
    """Measures a pair now and then and pools what it finds over the last looks; for one thread at a time.

    `alignment` is None until one can be told, and changes only when another is significantly better; it is for images
    of the size of the last look, a change of which begins anew. The same looks give the same alignments: there is no
    clock.
    """

    def __init__(self, min_disparity: int, num_disparities: int) -> None:
        """The search range is min_disparity .. min_disparity + num_disparities - 1, px."""
        self._search = (min_disparity, min_disparity + num_disparities - 1)
        self._looks: deque[RowPoints] = deque(maxlen=LOOKS)
        self._shape: tuple[int, ...] = ()
        self._alignment: RowAlignment | None = None

    @property
    def alignment(self) -> RowAlignment | None:
        """The best that is known; the same object until it changes. The identity where rows have come to be aligned."""
        return self._alignment

    def look(self, left: Image, right: Image) -> bool:
        """Measure a pair as the cameras gave it (not aligned): whether `alignment` has changed.

        left, right: as in `measure_rows`. Raises ValueError where their sizes differ.
        """
        shape = left.shape[:2]
        if right.shape[:2] != shape:
            raise ValueError(f'left image {shape[1]} x {shape[0]} px and right image {right.shape[1]} x '
                             f'{right.shape[0]} px must have the same size')
        if shape != self._shape:
            self.reset()
            self._shape = shape
        known = None if self._is_lost() else self._alignment
        self._looks.append(off_by(known, (grey_of(left), grey_of(right)), self._search, _CORNERS))
        return self._renew(pooled(list(self._looks)))

    def reset(self) -> None:
        """Forget all: the cameras have changed."""
        self._looks.clear()
        self._alignment = None

    def _is_lost(self) -> bool:
        """Whether so little is found of late that the alignment itself may be what is wrong."""
        return len(self._looks) == LOOKS and not can_tell(pooled(list(self._looks)), self._shape)

    def _renew(self, points: RowPoints) -> bool:
        if not can_tell(points, self._shape):
            return False
        found = fit_rows(points, self._shape, self._alignment)
        if self._alignment is None:
            self._alignment = found
            return found is not None
        height, width = self._shape
        found = found or RowAlignment.identity(width, height)
        if _apart(found, self._alignment) <= _CHANGE or not is_better(points, found, self._alignment):
            return False
        self._alignment = found
        return True


def _apart(one: RowAlignment, another: RowAlignment) -> float:
    """Root mean square of the difference over the image, px."""
    x, y = np.meshgrid(np.linspace(0, one.width - 1, 9), np.linspace(0, one.height - 1, 9))
    return float(np.sqrt(np.mean((one.offsets(x, y) - another.offsets(x, y))**2)))
