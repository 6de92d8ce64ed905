"""The way of a pair through the engine: stages 1 to 3 by stripes, in bytes. The object owns its buffers."""
from __future__ import annotations

import numpy as np

from .cost_aggregation import AGGREGATIONS
from .cost_aggregation.aggregation import Pair, StripeAggregation, View
from .disparity_optimization.paths import masks_of
from .disparity_optimization.penalties import Penalties, fill_penalties, p2_table
from .disparity_optimization.semiglobal import StripeWinners, Views, scratch_size, smooth_stripes
from .disparity_optimization.winners import Winners
from .kernels.stripes import block_count, rows_of, stripe_count
from .kernels.wide import lanes_for, width_of
from .matching_cost.byte_costs import ByteCosts, byte_costs, has_differences, largest_cost
from .matching_cost.edges import empty_edges, fill_edges
from .matching_cost.planes import INTENSITY, empty_planes
from .matching_cost.preparation import PairImages, fill_plane_blocks, smoothed_guide
from .parameters import MatcherParameters
from .phases import Phase

_BYTE = 255  # what a lane of the sums holds
_SMALLEST_EDGE = 1e-6
"""Grey levels; below, all edges take P2 away, and quotients overflow."""


class StripeRoute:
    """For images of one shape and one search range."""

    def __init__(self, shape: tuple[int, ...], parameters: MatcherParameters) -> None:
        self._lanes = lanes_for(parameters.num_disparities)
        lanes, start = width_of(self._lanes), parameters.min_disparity
        self.left, self.right = rows_of(shape, 1), rows_of(shape, parameters.right_rows)
        self._planes = empty_planes(shape, range(start, start + lanes), has_differences(parameters),
                                    parameters.census_weight > 0)
        channels = 1 if len(shape) == 2 else shape[2]
        kinds = parameters.aggregation, right_aggregation(parameters, channels)
        self.sides: list[StripeAggregation] = [
            AGGREGATIONS[kind].load()(View(number, rows, lanes, channels))
            for number, (kind, rows) in enumerate(zip(kinds, (self.left, self.right), strict=True))]
        self._edges, self._tree_edges = empty_edges(self.left), empty_edges(self.left)
        self._across, self._down = np.zeros((2, 2, (self.left.height + 2) * self.left.width), np.uint8)
        self._costs_for: MatcherParameters | None = None
        self._kept_costs: list[ByteCosts] = []
        height, width = shape[:2]
        self.winners = StripeWinners(
            np.zeros((height, width), np.int16), np.zeros((self.right.height, width), np.int16),
            np.zeros((height, width) if parameters.subpixel else (0, 0), np.float32),
            np.zeros((height, width), np.uint8), masks_of(parameters.num_disparities, lanes),
            parameters.num_disparities)

    @staticmethod
    def layout(shape: tuple[int, ...], parameters: MatcherParameters) -> tuple[object, ...]:
        """What the buffers follow from."""
        return (StripeRoute, shape, parameters.min_disparity, parameters.num_disparities, parameters.right_rows,
                has_differences(parameters), parameters.census_weight > 0, parameters.aggregation, parameters.subpixel)

    def phases(self, images: PairImages, parameters: MatcherParameters) -> list[Phase]:
        """Stages 1 to 3 of a pair whose levels are there."""
        blocks = block_count(self.left.height) + block_count(self.right.height)
        rows = self.left, self.right
        pair = Pair(images, self._tree_edges if parameters.guide_blur > 1 else self._edges)
        phases = [Phase('matching_cost', 2 * block_count(self.left.height), fill_plane_blocks,
                        (images, self._planes, np.float32(INTENSITY), parameters.gradient == 'magnitude')),
                  Phase('matching_cost', blocks, fill_edges, (self._edges, images, *rows))]
        if parameters.guide_blur > 1:
            left, right = (smoothed_guide(image, parameters.guide_blur) for image in (images.left, images.right))
            smoothed = images._replace(left=left, right=right)
            phases.append(Phase('spanning_forest', blocks, fill_edges, (pair.tree_edges, smoothed, *rows)))
        penalties = self._penalties(parameters, float(images.level_unit))
        phases.append(Phase('disparity_optimization', blocks, fill_penalties, (penalties, self._edges, *rows)))
        costs = self._costs(parameters)
        for side, own in zip(self.sides, costs, strict=True):
            phases += side.phases(own, pair, parameters)
        # Boxes of either view have the same costs; where only one has boxes, they are its own.
        boxes = costs[1] if self.sides[0].volume.size else costs[0]
        views = Views(self.left.height, self.right.height, self.left.width, self.right.every, parameters.paths,
                      self.sides[0].volume, self.sides[1].volume)
        phases.append(Phase('disparity_optimization', stripe_count(self.left) + stripe_count(self.right),
                            smooth_stripes, (boxes, penalties, views, self.winners, self._lanes),
                            scratch_size(self.left.width, width_of(self._lanes), parameters.paths)))
        return phases

    def result(self) -> Winners:
        """After the phases."""
        found = self.winners
        return Winners(found.left, found.right, self.right.every, found.vertex, found.margin)

    def _costs(self, parameters: MatcherParameters) -> list[ByteCosts]:
        """Of both views; made anew where the parameters have changed."""
        if parameters is not self._costs_for:
            self._costs_for, lanes = parameters, width_of(self._lanes)
            self._kept_costs = [
                byte_costs(self._planes, self.left.width, parameters, lanes, _pixel_cost(side, parameters))
                for side in self.sides]
        return self._kept_costs

    def _penalties(self, parameters: MatcherParameters, level_unit: float) -> Penalties:
        largest = max(largest_cost(parameters), 1e-9)
        units = [side.full_cost * _pixel_cost(side, parameters) / side.pixel_cost / largest for side in self.sides]
        p1 = [min(round(min(parameters.p1, parameters.p2) * unit), 255) for unit in units]
        edge = max(parameters.p2_edge, _SMALLEST_EDGE) / level_unit if parameters.p2_edge else 0.0
        p2 = [p2_table(p1[k], parameters.p2 * unit, edge) for k, unit in enumerate(units)]
        return Penalties(np.uint8(p1[0]), np.uint8(p1[1]), p2[0], p2[1], self._across, self._down)


def _pixel_cost(side: StripeAggregation, parameters: MatcherParameters) -> int:
    """What the largest cost of two pixels is scaled to: less than the aggregation's own where P2 is so much larger that
    an aggregated cost and P2 together would not stay in a byte."""
    jump = parameters.p2 / max(largest_cost(parameters), 1e-9)
    return max(1, min(side.pixel_cost, int(side.pixel_cost * _BYTE / (side.full_cost * (1 + jump)) + 1e-6)))


def right_aggregation(parameters: MatcherParameters, channels: int) -> str:
    """How the right view is aggregated, which serves the left-right check only."""
    return 'box' if parameters.right_rows > 1 and channels == 1 else parameters.aggregation
