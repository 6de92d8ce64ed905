"""What an aggregation of stage 2 has to offer to the stripe engine."""
from __future__ import annotations

import abc
from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Uint8, aligned_zeros
from ..kernels.stripes import Rows
from ..matching_cost.byte_costs import ByteCosts
from ..matching_cost.edges import Edges
from ..matching_cost.preparation import PairImages
from ..parameters import MatcherParameters
from ..phases import Phase


class View(NamedTuple):
    """One view of a stream of pairs. number: 0 is left, 1 the mirrored right one. rows: which are matched. lanes:
    disparities of a vector. channels: 1 or 3."""

    number: int
    rows: Rows
    lanes: int
    channels: int


class Pair(NamedTuple):
    """What an aggregation may look at: the images, and their edges, smoothed by `guide_blur`."""

    images: PairImages
    tree_edges: Edges


class StripeAggregation(abc.ABC):
    """Aggregated costs of one view, in bytes, and the buffers that this takes.

    pixel_cost: what stage 1 scales the largest cost of two pixels to, at most 255. full_cost: what the aggregated cost
    is where all pixels cost that much; with P2 it should stay below 256. volume: uint8 (rows * W * lanes), the
    aggregated costs by row, pixel and disparity, filled by the phases; or empty, where stage 3 is to sum up 3x3 boxes
    by itself.
    """

    pixel_cost: int
    full_cost: float

    def __init__(self, view: View) -> None:
        self.view = view
        self.volume: Uint8 = aligned_zeros((view.rows.height * view.rows.width * view.lanes,), np.uint8)

    @abc.abstractmethod
    def phases(self, costs: ByteCosts, pair: Pair, parameters: MatcherParameters) -> list[Phase]:
        """What fills the volume of a pair."""
