"""Stage 2, cost aggregation along the minimum spanning forest (eqs 12-13), exact in two passes (Yang 2012).

The passes stream through nodes in breadth-first order, node k's costs are row k: a parent stands before its
children, and the children of one parent side by side. The upward pass computes the matching costs as it goes and
the downward pass hands each finished row to stage 3, so that nothing is stored but the rows of one block.
"""
from __future__ import annotations

import dataclasses

import numba
import numpy as np

from ..disparity_optimization.winners import Winners, take_smallest
from ..kernels.arrays import Float32, Int16, Int32, Uint8, Uint16, UInt64
from ..kernels.compilation import kernel
from ..kernels.vectors import load, minimum, pointer, splat, store, to_uint16
from ..matching_cost.planes import (
    CostScale,
    MatchingPlanes,
    cost_scale,
    cost_terms,
    cost_vector,
    gather_nodes,
    gather_pixels,
)
from ..parameters import MatcherParameters
from .spanning_forest import SpanningTrees


@dataclasses.dataclass(frozen=True, slots=True)
class ForestNodes:
    """All that the passes read of the nodes, in breadth-first order; view 0 is left, view 1 the mirrored right one.

    similarity: float32 (2, N), support across the edge to the parent.
    inner: uint8 (2, N), 1 where a node has children, else 0. partner, own, own_census: of `gather_nodes`.
    """

    similarity: Float32
    inner: Uint8
    partner: Int32
    own: Float32
    own_census: UInt64

    @classmethod
    def empty(cls, planes: MatchingPlanes, nodes: int) -> ForestNodes:
        """Room for two views of `nodes` nodes each, whose values come from such planes."""
        own_census = np.zeros((2, nodes if planes.census.size else 0), np.uint64)
        return cls(np.zeros((2, nodes), np.float32), np.zeros((2, nodes), np.uint8), np.zeros((2, nodes), np.int32),
                   np.zeros((2, nodes * planes.values.shape[1]), np.float32), own_census)

    def gather_pixels(self, planes: MatchingPlanes, width: int) -> None:
        """From the planes alone, W = width: the nodes in the order of the pixels, without a tree."""
        gather_pixels(planes.values, planes.census, width, self.partner, self.own, self.own_census)

    def gather(self, trees: SpanningTrees, planes: MatchingPlanes, width: int, parameters: MatcherParameters) -> None:
        """From the trees and the planes of a pair, W = width."""
        similarities = _similarities(parameters.sigma_tree, parameters.d_y)
        _supports(trees.parent, trees.weight, similarities, self.similarity, self.inner)
        gather_nodes(planes.values, planes.census, trees.pixel, width, self.partner, self.own, self.own_census)


def edge_similarity(weight: Uint8, sigma_tree: float, d_y: int) -> Float32:
    """Support across an edge: exp(-weight / (255 sigma_tree)), 0 where weight > d_y cuts the tree (eq 10).

    weight: uint8, grey levels. sigma_tree on 0..1, d_y in grey levels. Returns float32 of the same shape.
    """
    return _similarities(sigma_tree, d_y)[weight]


def _similarities(sigma_tree: float, d_y: int) -> Float32:
    levels = np.arange(256)
    return np.where(levels > d_y, 0.0, np.exp(-levels / (255 * sigma_tree))).astype(np.float32)


def aggregate(
    trees: SpanningTrees, nodes: ForestNodes, planes: MatchingPlanes, parameters: MatcherParameters, scratch: Float32,
    winners: Winners,
) -> None:
    """Stages 1 and 2 over all disparities; the winners take what comes out.

    scratch: float32 (2, slots, N * BLOCK), finite; each slot of each view is one task, which works through its
    share of the disparities a block at a time. Costs are sums weighted by support and not divided by its sum: one
    factor a node changes neither its winner nor its vertex.
    """
    values = planes.values.reshape(2, -1)
    census = planes.census.reshape(2, -1)
    size = planes.values[0, 0].size
    _aggregate(trees.parent, nodes.similarity, nodes.inner, nodes.partner, nodes.own, nodes.own_census, values,
               census, size, cost_scale(parameters), cost_terms(parameters), parameters.min_disparity,
               parameters.num_disparities, parameters.subpixel, scratch, winners.best, winners.index, winners.beside)


def aggregate_volume(
    trees: SpanningTrees, nodes: ForestNodes, planes: MatchingPlanes, parameters: MatcherParameters, scratch: Float32,
    factor: float, stride: int, volume: Uint16,
) -> None:
    """Stages 1 and 2 over all disparities, into volume: uint16 (2, N * stride), by pixel, not mirrored back.

    Divided by the sum of supports, so that pixels compare, and times `factor`; the disparities from num_disparities
    up to `stride` cost the most there is. scratch: as for `aggregate`.
    """
    sums = np.empty(nodes.similarity.shape, np.float32)
    _support_sums(trees.parent, nodes.similarity, sums)
    scale = cost_scale(parameters)
    _aggregate_volume(trees.parent, nodes.similarity, nodes.inner, nodes.partner, nodes.own, nodes.own_census,
                      planes.values.reshape(2, -1), planes.census.reshape(2, -1), planes.values[0, 0].size,
                      scale, cost_terms(parameters), parameters.min_disparity, parameters.num_disparities,
                      scratch, trees.pixel, np.float32(factor) / sums, np.float32(scale[4] * factor), stride, volume)


@kernel(parallel=True)
def _support_sums(parent: Int32, similarity: Float32, sums: Float32) -> None:
    """The two passes over ones: the sum of all supports of each node."""
    for view in numba.prange(parent.shape[0]):
        total = sums[view]
        total[:] = 1
        for k in range(total.size - 1, 0, -1):
            total[parent[view, k]] += similarity[view, k] * total[k]
        for k in range(1, total.size):
            s = similarity[view, k]
            total[k] = s * total[parent[view, k]] + (np.float32(1) - s * s) * total[k]


@kernel(parallel=True)
def _aggregate_volume(
    parent: Int32, similarity: Float32, inner: Uint8, partner: Int32, own: Float32, own_census: UInt64,
    values: Int16, census: UInt64, size: int, scale: CostScale, terms: tuple[bool, bool], min_disparity: int,
    num_disparities: int, scratch: Float32, pixel: Int32, factor: Float32, largest: np.float32, stride: int,
    volume: Uint16,
) -> None:
    views, slots, length = scratch.shape
    block = length // parent.shape[1]
    rounds = -(-stride // (slots * block))
    for task in numba.prange(views * slots):
        view, slot = task // slots, task % slots
        for first in range(slot * rounds * block, min(stride, (slot + 1) * rounds * block), block):
            _leaf_to_root(parent[view], similarity[view], inner[view], partner[view], own[view], own_census[view],
                          values[1 - view], census[1 - view], size, scale, terms, min_disparity + first,
                          scratch[view, slot])
            _root_to_volume(parent[view], similarity[view], first, _behind(first, num_disparities, block, 0.5, 1e9),
                            scratch[view, slot], pixel[view], factor[view], largest, stride, volume[view])


@kernel
def _root_to_volume(
    parent: Int32, similarity: Float32, first: int, behind: Float32, rows: Float32, pixel: Int32, factor: Float32,
    largest: np.float32, stride: int, volume: Uint16,
) -> None:
    """The downward pass of `_root_to_leaf`; the finished rows, scaled and `behind` added, go to their pixels."""
    block = rows.size // parent.size
    at, volume_at, barrier, most = pointer(rows), pointer(volume), load(pointer(behind), 0), splat(largest)
    for k in range(parent.size):
        s = similarity[k] if k > 0 else np.float32(0)
        row = splat(s) * load(at, parent[k] * block) + splat(np.float32(1) - s * s) * load(at, k * block)
        store(at, k * block, row)
        scaled = minimum(row * splat(factor[k]) + barrier, most)
        store(volume_at, np.int64(pixel[k]) * stride + first, to_uint16(scaled))


@kernel(parallel=True)
def _supports(parent: Int32, weight: Uint8, similarities: Float32, similarity: Float32, inner: Uint8) -> None:
    views, nodes = parent.shape
    inner[:] = 0
    for view in numba.prange(views):
        for k in range(nodes):
            similarity[view, k] = similarities[weight[view, k]]
        for k in range(1, nodes):
            inner[view, parent[view, k]] = 1


@kernel(parallel=True)
def _aggregate(
    parent: Int32, similarity: Float32, inner: Uint8, partner: Int32, own: Float32, own_census: UInt64,
    values: Int16, census: UInt64, size: int, scale: CostScale, terms: tuple[bool, bool], min_disparity: int,
    num_disparities: int, subpixel: bool, scratch: Float32, best: Int32, index: Int32, beside: Float32,
) -> None:
    views, slots, length = scratch.shape
    block = length // parent.shape[1]
    rounds = -(-num_disparities // (slots * block))
    for task in numba.prange(views * slots):
        view, slot = task // slots, task % slots
        start, stop = slot * rounds * block, min(num_disparities, (slot + 1) * rounds * block)
        for first in range(start, stop, block):
            _leaf_to_root(parent[view], similarity[view], inner[view], partner[view], own[view], own_census[view],
                          values[1 - view], census[1 - view], size, scale, terms, min_disparity + first,
                          scratch[view, slot])
            _root_to_leaf(parent[view], similarity[view], first, start, _behind(first, stop, block, 0, np.inf),
                          subpixel and view == 0, scratch[view, slot], best[view, slot], index[view, slot],
                          beside[slot])


@kernel
def _leaf_to_root(
    parent: Int32, similarity: Float32, inner: Uint8, partner: Int32, own: Float32, own_census: UInt64,
    values: Int16, census: UInt64, size: int, scale: CostScale, terms: tuple[bool, bool],
    disparity: int, rows: Float32,
) -> None:
    """A_up(p) = C(p) + sum over children c of S(c) A_up(c); rows (N * BLOCK), their content of before is void."""
    block = rows.size // parent.size
    planes = values.size // size
    at, own_at, own_census_at = pointer(rows), pointer(own), pointer(own_census)
    values_at, census_at = pointer(values), pointer(census)
    children = splat(np.float32(0))
    parent_before = np.int32(-1)
    for k in range(parent.size - 1, -1, -1):
        cost = cost_vector(own_at, own_census_at, k, values_at, census_at, terms, planes, size,
                           partner[k] + disparity, scale)
        row = cost + splat(np.float32(inner[k])) * load(at, k * block)
        store(at, k * block, row)
        above = parent[k]
        sibling = np.float32(1) if above == parent_before else np.float32(0)
        children = splat(sibling) * children + splat(similarity[k]) * row
        if k > 0:
            store(at, above * block, children)
        parent_before = above


@kernel
def _behind(first: int, stop: int, block: int, inside: float, outside: float) -> Float32:
    """What is added to a block of costs: `inside` up to disparity `stop`, `outside` from there on."""
    added = np.full(block, np.float32(inside))
    added[min(max(stop - first, 0), block):] = outside
    return added


@kernel
def _root_to_leaf(
    parent: Int32, similarity: Float32, first: int, start: int, behind: Float32, subpixel: bool, rows: Float32,
    best: Int32, index: Int32, beside: Float32,
) -> None:
    """A(v) = S(v) A(parent) + (1 - S(v)^2) A_up(v); the finished row, `behind` added, goes to `take_smallest`."""
    block = rows.size // parent.size
    barrier = load(pointer(behind), 0)
    at, best_at, index_at, beside_at = pointer(rows), pointer(best), pointer(index), pointer(beside)
    for k in range(parent.size):
        s = similarity[k] if k > 0 else np.float32(0)
        row = splat(s) * load(at, parent[k] * block) + splat(np.float32(1) - s * s) * load(at, k * block)
        store(at, k * block, row)
        take_smallest(row + barrier, at, block, k, first, start, subpixel, best_at, index_at, beside_at, best.size)
