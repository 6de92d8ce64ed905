"""The way of a pair through the paper's own equations: one tree over each whole image, in float32."""
from __future__ import annotations

import numpy as np

from .cost_aggregation.exact_tree import aggregate, empty_nodes, gather
from .cost_aggregation.spanning_forest import SpanningTrees
from .disparity_optimization.winners import Winners, empty_best, winners_of
from .kernels.arrays import aligned_zeros
from .kernels.stripes import block_count
from .matching_cost.float_costs import BLOCK, empty_values
from .matching_cost.planes import INTENSITY, empty_planes
from .matching_cost.preparation import PairImages, fill_plane_blocks, smoothed_guide
from .parameters import MatcherParameters
from .phases import Crew, Phase, StageClock

_NODE_BYTES = 70
"""The trees and what is compared along them, each pixel."""

_SLOT_BYTES = 2 * 4 * BLOCK + 32
"""The costs in work and the best so far, each pixel."""

_COST_BYTES = 256 * 2**20
"""Most that the costs in work may take, where one block of either view takes less: memory must not grow with cores."""


def is_exact(parameters: MatcherParameters) -> bool:
    """Whether stages 1 to 3 are the paper's own equations."""
    return parameters.aggregation == 'tree' and parameters.p2 == 0


def exact_bytes(pixels: int, parameters: MatcherParameters, threads: int) -> int:
    """About what this route takes in memory."""
    return pixels * (_NODE_BYTES + _SLOT_BYTES * _slots(pixels, parameters.num_disparities, threads))


class ExactRoute:
    """For images of one shape, one search range and one number of threads."""

    def __init__(self, shape: tuple[int, ...], parameters: MatcherParameters, threads: int) -> None:
        pixels, disparities = shape[0] * shape[1], parameters.num_disparities
        self._slots = _slots(pixels, disparities, threads)
        self._per_slot = -(-disparities // (self._slots * BLOCK)) * BLOCK
        start = parameters.min_disparity
        self._planes = empty_planes(shape, range(start, start + self._slots * self._per_slot), True,
                                    parameters.census_weight > 0)
        self._trees = SpanningTrees.empty(shape)
        self._nodes, self._values = empty_nodes(self._trees), empty_values(self._planes, pixels)
        self._scratch = aligned_zeros((2, self._slots, pixels * BLOCK), np.float32)
        self._best = empty_best(self._slots, pixels, parameters.subpixel)

    @staticmethod
    def layout(shape: tuple[int, ...], parameters: MatcherParameters, threads: int) -> tuple[object, ...]:
        """What the buffers follow from."""
        return (ExactRoute, shape, parameters.min_disparity, parameters.num_disparities, parameters.census_weight > 0,
                parameters.subpixel, threads)

    def run(self, images: PairImages, parameters: MatcherParameters, crew: Crew, clock: StageClock) -> Winners:
        """Stages 1 to 3 of a pair whose levels are there."""
        height, width = images.left.shape[:2]
        with clock.stage('spanning_forest'):
            # The costs are not needed yet; what is left there, small integers, are finite floats.
            left, right = (smoothed_guide(image, parameters.guide_blur) for image in (images.left, images.right))
            step = 1 / float(images.level_gain)
            self._trees.build(left, right[:, ::-1], self._scratch[:, 0].view(np.int32), step)
        clock.work(crew, [Phase('matching_cost', 2 * block_count(height), fill_plane_blocks,
                                (images, self._planes, np.float32(INTENSITY), parameters.gradient == 'magnitude'))])
        with clock.stage('matching_cost'):
            gather(self._nodes, self._values, self._trees, width, parameters, float(images.level_unit))
        with clock.stage('cost_aggregation'):
            aggregate(self._nodes, self._values, parameters, self._scratch, self._best)
        with clock.stage('disparity_optimization'):
            left, right, vertex = winners_of(self._best, self._trees.pixel, (height, width),
                                             parameters.num_disparities, self._per_slot)
        nothing = np.zeros((0, 0), np.float32)
        return Winners(left, right, 1, vertex if parameters.subpixel else nothing, nothing.astype(np.uint8))


def _slots(nodes: int, num_disparities: int, threads: int) -> int:
    """Ranges of disparities in work side by side: one for each two threads, as long as they fit into _COST_BYTES."""
    blocks = -(-num_disparities // BLOCK)
    fitting = _COST_BYTES // (2 * nodes * BLOCK * 4)
    wanted = max(1, min(threads // 2, blocks, fitting))
    return -(-blocks // -(-blocks // wanted))  # none of them empty
