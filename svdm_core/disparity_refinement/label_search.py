"""The search of a weighted median among labels: which label is looked at next."""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..kernels.compilation import kernel


class LabelSearch(NamedTuple):
    """The median is one of low .. high; probe: the label whose weight is summed next; step: of the gallop."""

    low: int
    high: int
    probe: int
    step: int


@kernel(inline=True)
def begun(guess: Any, most: int) -> LabelSearch:
    """Among 0 .. most, from `guess` on: most medians are near to what the pixel has."""
    probe: Any = np.int64(guess)  # of an array of labels, maybe
    return LabelSearch(0, most, probe, 1)


@kernel(inline=True)
def narrowed(search: LabelSearch, is_half: bool) -> LabelSearch:
    """is_half: whether half of the weight is at or below the probe. Gallops four steps, then bisects."""
    low, high, probe, step = search
    if is_half:
        high, probe = probe, max(low, probe - step)
    else:
        low, probe = probe + 1, min(high - 1, probe + step)
    if probe < low or probe >= high or step > 8:
        probe = (low + high) // 2
    return LabelSearch(low, high, probe, 2 * step)
