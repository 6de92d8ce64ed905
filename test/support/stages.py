"""The stages opened up, so that tests see what goes from one to the next; run as the matcher runs them."""
import numpy as np

from svdm_core.cost_aggregation import exact_tree
from svdm_core.cost_aggregation.spanning_forest import SpanningTrees
from svdm_core.disparity_optimization.winners import empty_best
from svdm_core.kernels.stripes import block_count
from svdm_core.kernels.wide import lanes_for, width_of
from svdm_core.matching_cost.byte_costs import byte_costs, has_differences
from svdm_core.matching_cost.edges import empty_edges, fill_edges
from svdm_core.matching_cost.float_costs import BLOCK, empty_values
from svdm_core.matching_cost.intensity_range import IntensityRange
from svdm_core.matching_cost.planes import INTENSITY, empty_planes
from svdm_core.matching_cost.preparation import fill_levels, fill_plane_blocks, images_of
from svdm_core.phases import Crew, Phase


def run(*phases, threads=1):
    """Do phases of tasks; scratch holds anything before."""
    crew = Crew()
    crew.gather(threads)
    for phase in phases:
        crew.work(phase._replace(scratch=max(phase.scratch, 64)), end=0)
        crew._arenas[:] = 253
        crew.work(phase)


def task_phase(tasks, kernel, *arguments, scratch=0):
    return Phase('test', tasks, kernel, arguments, scratch)


def images(left, right, parameters):
    """`PairImages` of a pair, grey images and levels filled."""
    left, right = (np.require(image, requirements=('C', 'W')) for image in (left, right))
    own = parameters.intensity_range == 'pair'
    found = IntensityRange.of(left, right) if own else IntensityRange.full(left.dtype)
    pair = images_of(left, right, found, None)
    run(task_phase(2 * block_count(left.shape[0]), fill_levels, pair))
    return pair


def planes(pair, parameters, lanes, has_values=True):
    """`MatchingPlanes` for vectors of so many lanes, filled."""
    height, width, channels = pair.left.shape
    shape = (height, width) if channels == 1 else (height, width, channels)
    start = parameters.min_disparity
    room = empty_planes(shape, range(start, start + lanes), has_values, parameters.census_weight > 0)
    run(task_phase(2 * block_count(height), fill_plane_blocks, pair, room, np.float32(INTENSITY),
                   parameters.gradient == 'magnitude'))
    return room


def edges(pair, left, right):
    """`Edges` of the rows of either view."""
    room = empty_edges(left)
    for part in room:
        part[:] = 99
    run(task_phase(block_count(left.height) + block_count(right.height), fill_edges, room, pair, left, right))
    return room


class ByteStage:
    """Stage 1 in bytes of a pair: lanes, planes, and costs scaled to `largest`."""

    def __init__(self, left, right, parameters, largest):
        self.lanes = lanes_for(parameters.num_disparities)
        self.width = width_of(self.lanes)
        self.pair = images(left, right, parameters)
        self.planes = planes(self.pair, parameters, self.width, has_differences(parameters))
        self.costs = byte_costs(self.planes, left.shape[1], parameters, self.width, largest)


class ExactStage:
    """Stages 1 to 3 of the exact tree."""

    def __init__(self, left, right, parameters, slots=1):
        self.shape, self.parameters = left.shape[:2], parameters
        self.nodes_count = self.shape[0] * self.shape[1]
        blocks = -(-parameters.num_disparities // BLOCK)
        self.per_slot = -(-blocks // slots) * BLOCK
        self.slots = -(-blocks * BLOCK // self.per_slot)
        self.pair = images(left, right, parameters)
        self.planes = planes(self.pair, parameters, self.slots * self.per_slot)
        self.trees = SpanningTrees.empty(left.shape)
        self.trees.build(left, right[:, ::-1], step=1 / float(self.pair.level_gain))
        self.nodes = exact_tree.empty_nodes(self.trees)
        self.values = empty_values(self.planes, self.nodes_count)
        exact_tree.gather(self.nodes, self.values, self.trees, self.shape[1], parameters, float(self.pair.level_unit))

    def volume(self, isolated=False):
        """Costs of both views on 0..1, float32 (2, H, W, D), the right view mirrored, aggregated or, isolated, not."""
        if isolated:
            self.nodes.similarity[:] = 0
        start, count = self.parameters.min_disparity, self.parameters.num_disparities
        volume = np.zeros((2, self.nodes_count, self.slots * self.per_slot), np.float32)
        for first in range(0, count, BLOCK):
            scratch = np.ones((2, 1, self.nodes_count * BLOCK), np.float32)  # what was there before must not matter
            block = self.parameters.replace(min_disparity=start + first, num_disparities=min(BLOCK, count - first))
            exact_tree.aggregate(self.nodes, self.values, block, scratch, empty_best(1, self.nodes_count))
            for view in range(2):
                volume[view, self.trees.pixel[view], first:first + BLOCK] = scratch[view, 0].reshape(-1, BLOCK)
        return volume.reshape(2, *self.shape, -1)[..., :count] / np.float32(INTENSITY)

    def best(self, kept=None):
        """`BestSoFar` over all disparities."""
        scratch = np.zeros((2, self.slots, self.nodes_count * BLOCK), np.float32)
        best = kept or empty_best(self.slots, self.nodes_count)
        exact_tree.aggregate(self.nodes, self.values, self.parameters, scratch, best)
        return best
