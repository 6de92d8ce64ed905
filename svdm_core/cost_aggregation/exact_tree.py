"""Stage 2, cost aggregation along the minimum spanning forest of the whole image (eqs 12-13), exact in two passes
(Yang 2012).

The passes stream through nodes in breadth-first order, node k's costs are row k: a parent stands before its
children, and the children of one parent side by side. The upward pass computes the matching costs as it goes and
the downward pass hands each finished row to stage 3, so that nothing is stored but the rows of one block.
"""
from __future__ import annotations

import functools
from typing import Any, NamedTuple

import numpy as np

from ..disparity_optimization.winners import BestSoFar, SlotPointers, slot_pointers, take_smallest
from ..kernels.arrays import Float32, Int32, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.tasks import do_tasks, share
from ..kernels.vectors import load, pointer, splat, store
from ..matching_cost.float_costs import (
    BLOCK,
    CostScale,
    NodeValues,
    ViewPointers,
    cost_scale,
    cost_vector,
    gather_values,
    view_pointers,
)
from ..parameters import MatcherParameters
from .spanning_forest import SpanningTrees


class TreeNodes(NamedTuple):
    """The trees as the passes read them, in breadth-first order; view 0 is left, view 1 the mirrored right one.

    parent: int32 (2, N). similarity: float32 (2, N), support across the edge to the parent. inner: uint8 (2, N), 1
    where a node has children, else 0.
    """

    parent: Int32
    similarity: Float32
    inner: Uint8


def empty_nodes(trees: SpanningTrees) -> TreeNodes:
    """Room for the nodes of such trees."""
    shape = trees.parent.shape
    return TreeNodes(trees.parent, np.zeros(shape, np.float32), np.zeros(shape, np.uint8))


def gather(
    nodes: TreeNodes, values: NodeValues, trees: SpanningTrees, width: int, parameters: MatcherParameters,
    level_unit: float = 1.0,
) -> None:
    """Take over the trees, and what stage 1 compares, of images `width` px wide."""
    do_tasks(_supports, 2, nodes, trees.weight, edge_similarities(parameters.sigma_tree, parameters.d_y, level_unit))
    gather_values(values, trees.pixel, width)


def edge_similarity(weight: Uint8, sigma_tree: float, d_y: int) -> Float32:
    """Support across an edge: exp(-weight / (255 sigma_tree)), 0 where weight > d_y cuts the tree (eq 10).

    weight: uint8, grey levels. sigma_tree on 0..1, d_y in grey levels. Returns float32 of the same shape.
    """
    return edge_similarities(sigma_tree, d_y)[weight]


@functools.lru_cache(maxsize=8)
def edge_similarities(sigma_tree: float, d_y: int, level_unit: float = 1.0) -> Float32:
    """`edge_similarity` of the weights 0 .. 255, each `level_unit` grey levels; d_y = 255 cuts none."""
    levels = np.arange(256) * level_unit
    most = d_y if d_y < 255 else np.inf
    return np.where(levels > most, 0.0, np.exp(-levels / (255 * sigma_tree))).astype(np.float32)


def aggregate(
    nodes: TreeNodes, values: NodeValues, parameters: MatcherParameters, scratch: Float32, winners: BestSoFar
) -> None:
    """Stages 1 and 2 over all disparities; the winners take what comes out.

    scratch: float32 (2, slots, N * BLOCK), finite; each slot of each view is one task, which works through its
    share of the disparities a block at a time. Costs are sums weighted by support and not divided by its sum: one
    factor a node changes neither its winner nor its vertex.
    """
    do_tasks(_aggregate, scratch.shape[0] * scratch.shape[1], nodes, values,
             _Sums(cost_scale(parameters), parameters.num_disparities, parameters.subpixel), scratch, winners)


@kernel
def _supports(
    counter: Int64, end: int, arenas: Uint8, nodes: TreeNodes, weight: Uint8, similarities: Float32
) -> None:
    share(_fill_supports, counter, end, arenas, (nodes, weight, similarities))


@kernel
def _fill_supports(view: int, _arena: Uint8, nodes: TreeNodes, weights: Uint8, similarities: Float32) -> None:
    parent, weight, similarity, inner = nodes.parent[view], weights[view], nodes.similarity[view], nodes.inner[view]
    inner[:] = 0
    for k in range(weight.size):
        similarity[k] = similarities[weight[k]]
        if k > 0:
            inner[parent[k]] = 1


class _Sums(NamedTuple):
    """What `aggregate` is asked for: winners among num_disparities, with their neighbours' costs where subpixel."""

    scale: CostScale
    num_disparities: int
    subpixel: bool


@kernel
def _aggregate(
    counter: Int64, end: int, arenas: Uint8, nodes: TreeNodes, values: NodeValues, sums: _Sums, scratch: Float32,
    winners: BestSoFar,
) -> None:
    share(_aggregate_slot, counter, end, arenas, (nodes, values, sums, scratch, winners))


@kernel
def _aggregate_slot(
    task: int, _arena: Uint8, nodes: TreeNodes, values: NodeValues, sums: _Sums, scratch: Float32, winners: BestSoFar
) -> None:
    scale, num_disparities, subpixel = sums
    slots = scratch.shape[1]
    rounds = -(-num_disparities // (slots * BLOCK))
    view, slot = task // slots, task % slots
    tree = _Tree(pointer(nodes.parent[view]), pointer(nodes.similarity[view]), pointer(nodes.inner[view]),
                 scratch.shape[2] // BLOCK)
    costs, rows = view_pointers(values, view), pointer(scratch[view, slot])
    best = slot_pointers(winners, view, slot, slot * rounds * BLOCK, subpixel and view == 0)
    for first in range(slot * rounds * BLOCK, min(num_disparities, (slot + 1) * rounds * BLOCK), BLOCK):
        _leaf_to_root(tree, costs, first, scale, rows)
        _root_to_leaf(tree, first, _behind(first, num_disparities), rows, best)


class _Tree(NamedTuple):
    """One view's nodes as pointers."""

    parent: Any
    similarity: Any
    inner: Any
    size: int


@kernel
def _leaf_to_root(tree: _Tree, costs: ViewPointers, first: int, scale: CostScale, rows: Any) -> None:
    """A_up(p) = C(p) + sum of S A_up(child), into rows, a pointer; `first`: disparity above min_disparity."""
    children = splat(np.float32(0))
    parent_before = np.int32(-1)
    for k in range(tree.size - 1, -1, -1):
        cost = cost_vector(costs, k, first, scale)
        row = cost + splat(np.float32(tree.inner[k])) * load(rows, k * BLOCK)
        store(rows, k * BLOCK, row)
        above = tree.parent[k]
        sibling = np.float32(1) if above == parent_before else np.float32(0)
        children = splat(sibling) * children + splat(tree.similarity[k]) * row
        if k > 0:
            store(rows, above * BLOCK, children)
        parent_before = above


@kernel
def _behind(first: int, stop: int) -> Float32:
    """What is added to a block of costs: 0 up to disparity `stop`, infinity from there on."""
    added = np.zeros(BLOCK, np.float32)
    added[min(max(stop - first, 0), BLOCK):] = np.inf
    return added


@kernel
def _root_to_leaf(tree: _Tree, first: int, behind: Float32, rows: Any, best: SlotPointers) -> None:
    """A(v) = S(v) A(parent) + (1 - S(v)^2) A_up(v); the finished row, `behind` added, goes to `take_smallest`."""
    barrier = load(pointer(behind), 0)
    for k in range(tree.size):
        s = tree.similarity[k] if k > 0 else np.float32(0)
        row = (splat(s) * load(rows, tree.parent[k] * BLOCK)
               + splat(np.float32(1) - s * s) * load(rows, k * BLOCK))
        store(rows, k * BLOCK, row)
        take_smallest(row + barrier, rows, k, first, best)
