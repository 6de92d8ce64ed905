"""Stage 2 by boxes: the support of a pixel is the 3x3 pixels around it, summed up row by row as they are needed."""
from __future__ import annotations

import numpy as np

from ..kernels.arrays import Uint8
from ..kernels.compilation import kernel
from ..kernels.stripes import Rows
from ..kernels.vectors import pointer
from ..kernels.wide import UNIT, Lanes, add_saturated, load_wide, shift_right, splat_wide, store_wide
from ..matching_cost.byte_costs import ByteCosts, cost_at, cost_row
from ..matching_cost.census import BITS
from ..parameters import MatcherParameters
from ..phases import Phase
from .aggregation import Pair, StripeAggregation, View

PIXEL_COST = BITS
"""The largest cost of two pixels, so that census distances need no scaling."""

_PAIR = (0, 0)

@kernel
def box_row(costs: ByteCosts, view: int, rows: Rows, y: int, known: int, ring: Uint8, into: Uint8, lanes: Lanes) -> int:
    """Costs of row y summed over 3x3 boxes, uint8 (W * lanes), into `into`; borders replicated.

    ring: scratch, uint8 (3, W * lanes), holds sums along rows up to row `known` - 1. Returns the new `known`.
    """
    while known <= min(y + 1, rows.height - 1):
        _sum_beside(costs, view, rows, known, ring[known % 3], lanes)
        known += 1
    above, below = ring[max(y - 1, 0) % 3], ring[min(y + 1, rows.height - 1) % 3]
    _sum_above(pointer(above), pointer(ring[y % 3]), pointer(below), rows.width * len(lanes) * UNIT, pointer(into))
    return known


@kernel
def _sum_beside(costs: ByteCosts, view: int, rows: Rows, y: int, into: Uint8, lanes: Lanes) -> None:
    """Costs of pixels x - 1, x and x + 1 of a row, summed: at most 102."""
    to, step = pointer(into), UNIT * len(lanes)
    row = cost_row(costs, view, rows.offset + rows.every * y, rows.width, 0)
    behind = pointer(costs.behind)
    before = splat_wide(np.uint8(0), lanes)
    here = before
    for x in range(rows.width):
        after = cost_at(row, x, behind, lanes)
        if x == 0:
            before, here = after, after
        else:
            store_wide(to, (x - 1) * step, before + here + after)
            before, here = here, after
    store_wide(to, (rows.width - 1) * step, before + here + here)


@kernel
def _sum_above(above: Uint8, here: Uint8, below: Uint8, size: int, to: Uint8) -> None:
    half = splat_wide(np.uint8(2), _PAIR)
    for o in range(0, size, UNIT * len(_PAIR)):
        total = add_saturated(add_saturated(load_wide(above, o, _PAIR), load_wide(below, o, _PAIR)),
                              add_saturated(load_wide(here, o, _PAIR), half))
        store_wide(to, o, shift_right(total, 2))


class BoxAggregation(StripeAggregation):
    """The 3x3 box around a pixel, which stage 3 sums up while it smooths (`box_row`): no volume, nothing to do before.

    Nine costs are cut off at 255 and divided by 4. Lost are costs above a mean of 28 of 34 differing bits, which do
    not win: where two pixels show different things, 17 differ.
    """

    pixel_cost = PIXEL_COST
    full_cost = 9 * PIXEL_COST / 4

    def __init__(self, view: View) -> None:
        super().__init__(view._replace(rows=view.rows._replace(height=0)))

    def phases(self, costs: ByteCosts, pair: Pair, parameters: MatcherParameters) -> list[Phase]:
        return []
