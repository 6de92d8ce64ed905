"""Stage 2, cost aggregation along the minimum spanning forest (eqs 12-13), exact in two passes (Yang 2012).

Costs lie in node order, node k's row is row k. A parent stands before its children, so both passes
stream through memory.
"""
from __future__ import annotations

import numba
import numpy as np

from .arrays import Float32, Int32, Uint8
from .matching_cost import BLOCK


def edge_similarity(weight: Uint8, sigma_tree: float, d_y: int) -> Float32:
    """Support across an edge: exp(-weight / (255 sigma_tree)), 0 where weight > d_y cuts the tree (eq 10).

    weight: uint8, grey levels. sigma_tree on 0..1, d_y in grey levels. Returns float32 of the same shape.
    """
    levels = np.arange(256)
    table = np.where(levels > d_y, 0.0, np.exp(-levels / (255 * sigma_tree)))
    return table.astype(np.float32)[weight]


@numba.njit(cache=True)
def _leaf_to_root(cost: Float32, parent: Int32, similarity: Float32) -> None:
    """A_up(p) = C(p) + sum over children c of S(c) A_up(c), in place."""
    for k in range(parent.size - 1, 0, -1):
        child, up, s = cost[k], cost[parent[k]], similarity[k]
        for j in range(BLOCK):
            up[j] += s * child[j]


@numba.njit(cache=True)
def _root_to_leaf(cost: Float32, parent: Int32, similarity: Float32) -> None:
    """A(v) = S(v) A(parent) + (1 - S(v)^2) A_up(v), in place."""
    for k in range(1, parent.size):
        row, up, s = cost[k], cost[parent[k]], similarity[k]
        rest = np.float32(1) - s * s
        for j in range(BLOCK):
            row[j] = s * up[j] + rest * row[j]


@numba.njit(cache=True, parallel=True)
def aggregate_blocks(cost: Float32, parent: Int32, similarity: Float32) -> None:
    """Sum of the support-weighted costs, in place: cost (2, blocks, N, BLOCK), parent and similarity (2, N).

    Not divided by the sum of supports: one factor a node changes neither its winner nor its parabola.
    """
    views, blocks = cost.shape[:2]
    for task in numba.prange(views * blocks):
        view, block = task // blocks, task % blocks
        _leaf_to_root(cost[view, block], parent[view], similarity[view])
        _root_to_leaf(cost[view, block], parent[view], similarity[view])
