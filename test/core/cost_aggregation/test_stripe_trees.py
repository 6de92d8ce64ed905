"""Trees of stripes against the support that the equations give, and their costs in bytes against sums in float64."""
import numpy as np
import oracles
import pytest
from scenes import noise
from stages import ByteStage, edges, run

from svdm_core import MatcherParameters
from svdm_core.cost_aggregation.aggregation import Pair, View
from svdm_core.cost_aggregation.stripe_trees import HALO, LARGEST, TreeAggregation
from svdm_core.kernels.stripes import STRIPE, rows_of

UNITS = 2
"""Of the 64 that the largest cost is: what the roundings of all nodes of a path, each below 1/256 of a byte, add to
the half of the last one."""


class Aggregated:
    def __init__(self, shape, count, every, sigma_tree, d_y=255):
        left, right = noise(*shape) // 8, noise(*shape, seed=1) // 8
        self.parameters = MatcherParameters(num_disparities=count, sigma_tree=sigma_tree, d_y=d_y, min_disparity=-2)
        stage = ByteStage(left, right, self.parameters, 255)
        self.rows = rows_of(shape, 1), rows_of(shape, every)
        self.images = left, right[self.rows[1].offset::self.rows[1].every, ::-1]
        self.unit = float(stage.pair.level_unit)
        pair = Pair(stage.pair, edges(stage.pair, *self.rows))
        self.lanes, self.stage, self.volumes, self.trees = stage.width, stage, [], []
        for view, rows in enumerate(self.rows):
            side = TreeAggregation(View(view, rows, stage.width, stage.pair.left.shape[2]))
            run(*side.phases(stage.costs, pair, self.parameters), threads=2)
            self.volumes.append(side.volume.reshape(rows.height, rows.width, stage.width).astype(int))
            self.trees.append(side._trees)

    def costs(self, view):
        """Of the matched rows of a view, in bytes."""
        planes, width = self.stage.planes, self.rows[0].width
        values, census = (part[..., planes.before:planes.before + width] for part in (planes.values, planes.census))
        every = self.rows[view]
        own, other = values[view], values[1 - view][..., ::-1]
        here = slice(every.offset, None, every.every)
        return oracles.byte_cost(own[:, here], other[:, here], census[view, here], census[1 - view, here, :, ::-1],
                                 self.stage.costs, self.lanes, 255)

    def stripes(self, view):
        """(first, last, low, high) of each: its rows, and those of its tree."""
        every, height = self.rows[view].every, self.rows[view].height
        size, halo = STRIPE // every, HALO // every
        for first in range(0, height, size):
            last = min(height, first + size)
            yield first, last, max(0, first - halo), min(height, last + halo)


def weights_of(image, pixel, parent):
    """Of the edge to the parent, by node; both must be neighbours."""
    planes, width = image.reshape(-1, *image.shape[2:]).astype(int), image.shape[1]
    above = pixel[parent]
    apart = np.abs(pixel[1:] - above[1:])
    beside = pixel[1:] // width == above[1:] // width
    assert ((apart == width) | (apart == 1) & beside).all()
    return np.abs(planes[pixel] - planes[above]).reshape(len(pixel), -1).max(axis=1)


@pytest.mark.parametrize(('shape', 'count', 'every', 'sigma_tree', 'd_y'), [
    ((1, 1), 1, 2, 0.1, 255), ((1, 9), 5, 2, 0.1, 255), ((9, 1), 33, 3, 0.1, 255), ((7, 9), 32, 1, 1.0, 255),
    ((8, 9, 3), 20, 2, 0.01, 255), ((8, 9), 20, 2, 0.1, 20), ((70, 4), 9, 2, 0.1, 255), ((131, 2), 9, 4, 0.5, 255),
])
def test_costs_are_means_weighted_by_support_along_minimum_trees(shape, count, every, sigma_tree, d_y):
    found = Aggregated(shape, count, every, sigma_tree, d_y)
    width = shape[1]
    for view in range(2):
        costs = found.costs(view)
        for stripe, (first, last, low, high) in enumerate(found.stripes(view)):
            nodes = (high - low) * width
            pixel, parent = (part[stripe, :nodes] for part in (found.trees[view].pixel, found.trees[view].parent))
            guide = found.images[view][low:high]
            assert sorted(pixel) == list(range(nodes)) and (parent[1:] < np.arange(1, nodes)).all()
            weight = weights_of(guide, pixel, parent)
            assert weight.sum() == oracles.spanning_tree_weight(guide)
            support = oracles.support(parent, weight * found.unit, sigma_tree, d_y if d_y < 255 else np.inf)
            mean = np.empty((nodes, found.lanes))
            mean[pixel] = support @ costs[low:high].reshape(nodes, -1)[pixel] / support.sum(axis=1, keepdims=True)
            expected = mean.reshape(high - low, width, -1)[first - low:last - low] * LARGEST / 255
            np.testing.assert_allclose(found.volumes[view][first:last], expected, atol=UNITS)
            assert np.abs(found.volumes[view][first:last] - expected).mean() < 0.5


def test_where_all_costs_are_the_largest_they_stay_the_largest():
    found = Aggregated((20, 30), 33, 1, 0.1)
    behind = found.volumes[0][..., 33:]
    assert behind.min() >= LARGEST - 1 and behind.max() == LARGEST
