"""Keeps the row alignment of a live camera up to date, look by look."""
from __future__ import annotations

from collections import deque

import numpy as np

from ..kernels.arrays import Image
from .alignment import RowAlignment, RowPoints, terms
from .estimation import off_by
from .fitting import fit_rows, pooled
from .measurement import grey_of

_CORNERS = 300
_LOOKS = 16
"""What was measured more looks ago counts no more."""
_CHANGE = 0.04
"""px, root mean square over the image, of a change that is worth making."""


class RowTracker:
    """Measures a pair now and then and pools what it finds over the last looks; for one thread at a time.

    `alignment` is None until one can be told, and changes only when another is significantly better; it is for images
    of the size of the last look, whose change begins anew. The same looks give the same alignments: there is no clock.
    """

    def __init__(self, min_disparity: int, num_disparities: int) -> None:
        """The search range is min_disparity .. min_disparity + num_disparities - 1, px."""
        self._search = (min_disparity, min_disparity + num_disparities - 1)
        self._looks: deque[RowPoints] = deque(maxlen=_LOOKS)
        self._shape: tuple[int, ...] = ()
        self._alignment: RowAlignment | None = None

    @property
    def alignment(self) -> RowAlignment | None:
        """The best that is known; the same object until it changes."""
        return self._alignment

    def look(self, left: Image, right: Image) -> bool:
        """Measure a pair as the cameras gave it (not aligned): whether `alignment` has changed.

        left, right: as in `measure_rows`.
        """
        shape = left.shape[:2]
        if shape != self._shape:
            self.reset()
            self._shape = shape
        pair = grey_of(left), grey_of(right)
        self._looks.append(off_by(self._alignment, pair, self._search, _CORNERS))
        found = fit_rows(pooled(list(self._looks)), shape, self._alignment)
        if found is None or not self._is_another(found):
            return False
        self._alignment = found
        return True

    def reset(self) -> None:
        """Forget all: the cameras have changed."""
        self._looks.clear()
        self._alignment = None

    def _is_another(self, found: RowAlignment) -> bool:
        if self._alignment is None:
            return True
        height, width = self._shape
        x, y = np.meshgrid(np.linspace(0, width - 1, 9), np.linspace(0, height - 1, 9))
        change = terms(x, y, self._shape) @ np.subtract(found.coefficients, self._alignment.coefficients)
        return bool(np.sqrt(np.mean(change**2)) > _CHANGE)
