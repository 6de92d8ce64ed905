"""Stages 1 to 3 opened up, so that tests see the costs that are never stored as a whole."""
import numpy as np
from svdm_core.cost_aggregation.tree import ForestNodes

from svdm_core.cost_aggregation import tree
from svdm_core.cost_aggregation.spanning_forest import SpanningTrees
from svdm_core.disparity_optimization.winners import Winners
from svdm_core.matching_cost.planes import BLOCK, INTENSITY, MatchingPlanes, cost_scale, cost_terms


class Stages:
    """What the matcher prepares for a pair; trees of the left image and the mirrored right one."""

    def __init__(self, left, right, parameters, slots=1, isolated=False):
        """isolated: no support from any other node, so that aggregated costs are matching costs."""
        self.shape, self.parameters = left.shape[:2], parameters
        self.nodes_count = self.shape[0] * self.shape[1]
        blocks = -(-parameters.num_disparities // BLOCK)
        self.per_slot = -(-blocks // slots) * BLOCK
        self.slots = -(-blocks * BLOCK // self.per_slot)
        end = parameters.min_disparity + self.slots * self.per_slot
        self.planes = MatchingPlanes.empty(left.shape, end, parameters.census_weight > 0)
        self.planes.fill(left, right, parameters.gradient)
        self.trees = SpanningTrees.empty(left.shape)
        guides = [(image >> 8).astype(np.uint8) if image.dtype == np.uint16 else image for image in (left, right)]
        self.trees.build(guides[0], guides[1][:, ::-1])
        self.nodes = ForestNodes.empty(self.planes, self.nodes_count)
        self.nodes.gather(self.trees, self.planes, self.shape[1], parameters)
        if isolated:
            self.nodes.similarity[:] = 0

    def volume(self):
        """Aggregated costs of both views on 0..1, float32 (2, H, W, D), the right view mirrored."""
        height, width = self.shape
        disparities, planes = self.parameters.num_disparities, self.planes.values.reshape(2, -1)
        volume = np.zeros((2, self.nodes_count, self.slots * self.per_slot), np.float32)
        for view in range(2):
            nodes = [part[view] for part in (self.trees.parent, self.nodes.similarity, self.nodes.inner)]
            for first in range(0, disparities, BLOCK):
                rows = np.ones(self.nodes_count * BLOCK, np.float32)  # what was there before must not matter
                tree._leaf_to_root(
                    *nodes, self.nodes.partner[view], self.nodes.own[view], self.nodes.own_census[view],
                    planes[1 - view], self.planes.census.reshape(2, -1)[1 - view], self.planes.values[0, 0].size,
                    cost_scale(self.parameters), cost_terms(self.parameters), self.parameters.min_disparity + first,
                    rows)
                behind = np.zeros(BLOCK, np.float32)
                scrap = Winners.empty(1, self.nodes_count)
                tree._root_to_leaf(*nodes[:2], first, 0, behind, view == 0, rows,
                                               scrap.best[view, 0], scrap.index[view, 0], scrap.beside[0])
                volume[view, self.trees.pixel[view], first:first + BLOCK] = rows.reshape(-1, BLOCK)
        return volume.reshape(2, height, width, -1)[..., :disparities] / np.float32(INTENSITY)

    def winners(self, winners=None):
        """Stage 3 as the matcher runs it: winner int32 (2, H, W), the right view mirrored, and vertex (H, W)."""
        scratch = np.zeros((2, self.slots, self.nodes_count * BLOCK), np.float32)
        winners = winners or Winners.empty(self.slots, self.nodes_count)
        tree.aggregate(self.trees, self.nodes, self.planes, self.parameters, scratch, winners)
        return winners.images(self.trees.pixel, self.shape, self.parameters.num_disparities, self.per_slot)
