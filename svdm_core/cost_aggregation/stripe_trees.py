"""Stage 2 along a minimum spanning tree of each stripe, in 16 bits (eqs 12-13, Yang 2012).

The two passes are divided by the sums of supports all the way, so that each step is a convex combination and nothing
overflows. With w the sum of supports below a node and t that of all, s the support across the edge to the parent q:

    up:    U(p) = C(p) / w(p) + sum over children c of s_c w(c) / w(p) U(c)
    down:  A(p) = g A(q) + (1 - g) U(p),  g = s t(q) / t(p)

A tree reaches HALO rows beyond its stripe. 32 disparities of a stripe are a task.
"""
from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Float32, Int32, Int64, Uint8, Uint16
from ..kernels.compilation import kernel
from ..kernels.instructions import multiply_high
from ..kernels.stripes import STRIPE, Rows, stripe_count, stripe_rows
from ..kernels.tasks import share
from ..kernels.vectors import pointer
from ..kernels.wide import load_wide, narrow_wide, shift_right, splat_wide, store_wide, widen
from ..matching_cost.byte_costs import ByteCosts, cost_at, cost_row
from ..matching_cost.edges import Edges
from ..parameters import MatcherParameters
from ..phases import Phase
from .aggregation import Pair, StripeAggregation, View
from .exact_tree import edge_similarities
from .spanning_forest import SPARE, build_tree

HALO = 8
"""Image rows that a tree reaches beyond its stripe."""

LARGEST = 64
"""The largest aggregated cost, in bytes: with P2 it stays in 8 bits, and so does half the sum of four paths where a
disparity is any good. 120 would be finer, and then sums saturate."""

PIXEL_COST = 255
"""The largest cost of two pixels, in bytes."""

_LANES = (0, 0)
UNIT = 32
"""Disparities of a task: one cache line of 16-bit sums a node."""

_ROWS = STRIPE + 2 * HALO


class StripeTrees(NamedTuple):
    """The trees of all stripes of one view, each in the breadth-first order of `SpanningTrees`.

    Each (stripes, nodes of the tallest): pixel: int32, number in the stripe's rows; parent: int32; own, share, down:
    uint16, 2^16 times 1 / w(p), s w(p) / w(q) and g of the equations; inner: uint16, 65535 where there are children.
    """

    pixel: Int32
    parent: Int32
    own: Uint16
    share: Uint16
    down: Uint16
    inner: Uint16


def empty_trees(stripes: int, rows: Rows) -> StripeTrees:
    """Room for the trees of one view."""
    nodes = (_ROWS // rows.every + 2) * rows.width + SPARE
    pixel, parent = np.empty((2, stripes, nodes), np.int32)
    own, share, down, inner = np.empty((4, stripes, nodes), np.uint16)
    return StripeTrees(pixel, parent, own, share, down, inner)


def scratch_size(rows: Rows) -> int:
    """Bytes of scratch that a task of either kernel takes."""
    nodes = (_ROWS // rows.every + 2) * rows.width + SPARE
    return max(nodes * (UNIT + 2 * UNIT) + 256, nodes * (4 * 4 + 2 * 4 + 5) + 1024)


@kernel
def _span(rows: Rows, stripe: int) -> tuple[int, int]:
    """The rows of the view that the tree of a stripe covers."""
    first, last = stripe_rows(rows, stripe)
    halo = HALO // rows.every
    return max(0, first - halo), min(rows.height, last + halo)


@kernel
def build_stripe_trees(
    counter: Int64, end: int, arenas: Uint8, trees: StripeTrees, rows: Rows, view: int, edges: Edges,
    similarities: Float32,
) -> None:
    """One tree a task. similarities: float32 (256), support by weight."""
    share(_build, counter, end, arenas, (trees, rows, view, edges, similarities))


@kernel
def _build(
    stripe: int, arena: Uint8, trees: StripeTrees, rows: Rows, view: int, edges: Edges, similarities: Float32
) -> None:
    first, last = _span(rows, stripe)
    height, width = last - first, rows.width
    nodes = height * width
    small = 5 * nodes + 2 * SPARE
    bytes_, rest = arena[:small], arena[(small + 63) // 64 * 64:]
    weight, links = bytes_[:nodes], bytes_[nodes:3 * nodes + 2 * SPARE].reshape(2, nodes + SPARE)
    weights = bytes_[3 * nodes + 2 * SPARE:].reshape(2, height, width)
    for y in range(height):  # of the edge to the pixel on the right, and below
        weights[0, y, :-1] = edges.across[view, first + y, 1:]
        weights[1, y] = edges.down[view, first + y + 1]
    numbers = rest[:4 * (5 * nodes + 2 * SPARE)].view(np.int32)
    room, scratch = numbers[:2 * (nodes + SPARE)].reshape(2, nodes + SPARE), numbers[2 * (nodes + SPARE):]
    build_tree(room, weight, scratch, links, weights)
    trees.pixel[stripe, :nodes] = room[0, :nodes]
    trees.parent[stripe, :nodes] = room[1, :nodes]
    sums = scratch[:2 * nodes].view(np.float32).reshape(2, nodes)
    _fill_shares(trees.parent[stripe, :nodes], weight, similarities, sums, (trees.own[stripe], trees.share[stripe],
                 trees.down[stripe], trees.inner[stripe]))


@kernel
def _sixteen_bits(share: np.float32) -> np.uint16:
    return np.uint16(min(share * np.float32(65536) + np.float32(0.5), np.float32(65535)))


@kernel
def _fill_shares(
    parent: Int32, weight: Uint8, similarities: Float32, sums: Float32, into: tuple[Uint16, Uint16, Uint16, Uint16]
) -> None:
    """own, share, down and inner of `StripeTrees`; sums: scratch, w and t of the equations."""
    below, total = sums[0], sums[1]
    own, share, down, inner = into
    nodes = parent.size
    below[:] = 1
    inner[:nodes] = 0
    for k in range(nodes - 1, 0, -1):
        below[parent[k]] += similarities[weight[k]] * below[k]
        inner[parent[k]] = 65535
    total[0] = below[0]
    own[0], share[0], down[0] = _sixteen_bits(np.float32(1) / below[0]), 0, 0
    for k in range(1, nodes):
        s, q = similarities[weight[k]], parent[k]
        total[k] = s * total[q] + (np.float32(1) - s * s) * below[k]
        own[k] = _sixteen_bits(np.float32(1) / below[k])
        share[k] = _sixteen_bits(s * below[k] / below[q])
        down[k] = _sixteen_bits(s * total[q] / total[k])


@kernel
def aggregate_blocks(
    counter: Int64, end: int, arenas: Uint8, trees: StripeTrees, rows: Rows, view: int, costs: ByteCosts, volume: Uint8
) -> None:
    """Stages 1 and 2 of UNIT disparities of a stripe a task; volume: uint8 (rows * W * lanes), by pixel."""
    share(_aggregate_block, counter, end, arenas, (trees, rows, view, costs, volume))


@kernel
def _aggregate_block(
    task: int, arena: Uint8, trees: StripeTrees, rows: Rows, view: int, costs: ByteCosts, volume: Uint8
) -> None:
    blocks = costs.behind.size // UNIT
    stripe, block = task // blocks, task % blocks
    low, high = _span(rows, stripe)
    nodes = (high - low) * rows.width
    raw, rest = arena[:nodes * UNIT], arena[nodes * UNIT:]
    sums = rest[:2 * nodes * UNIT].view(np.uint16)
    for y in range(low, high):
        _fill_costs(costs, rows, view, y, block * UNIT, raw[(y - low) * rows.width * UNIT:])
    tree = _Tree(pointer(trees.pixel[stripe]), pointer(trees.parent[stripe]), pointer(trees.own[stripe]),
                 pointer(trees.share[stripe]), pointer(trees.down[stripe]), pointer(trees.inner[stripe]), nodes)
    _leaf_to_root(tree, pointer(raw), pointer(sums))
    first, last = stripe_rows(rows, stripe)
    inside = (first - low) * rows.width, (last - low) * rows.width
    _root_to_volume(tree, pointer(sums), inside, costs.behind.size,
                    pointer(volume[first * rows.width * costs.behind.size + block * UNIT:]))


@kernel
def _fill_costs(costs: ByteCosts, rows: Rows, view: int, y: int, first: int, into: Uint8) -> None:
    row = cost_row(costs, view, rows.offset + rows.every * y, rows.width, first)
    behind, to = pointer(costs.behind[first:]), pointer(into)
    for x in range(rows.width):
        store_wide(to, x * UNIT, cost_at(row, x, behind, _LANES))


class _Tree(NamedTuple):
    """One tree as pointers."""

    pixel: Int32
    parent: Int32
    own: Uint16
    share: Uint16
    down: Uint16
    inner: Uint16
    nodes: int


@kernel
def _leaf_to_root(tree: _Tree, costs: Uint8, sums: Uint16) -> None:
    """sums[k]: U of node k in 16 bits; costs: by pixel, in bytes."""
    children = splat_wide(np.uint16(0), _LANES)
    whole = splat_wide(np.uint16(256), _LANES)
    parent_before = np.int32(-1)
    for k in range(tree.nodes - 1, -1, -1):
        cost = widen(load_wide(costs, np.int64(tree.pixel[k]) * UNIT, _LANES)) * whole
        row = (multiply_high(cost, splat_wide(tree.own[k], _LANES))
               + (load_wide(sums, k * UNIT, _LANES) & splat_wide(tree.inner[k], _LANES)))
        store_wide(sums, k * UNIT, row)
        parent = tree.parent[k]
        sibling = np.uint16(65535) if parent == parent_before else np.uint16(0)
        children = (children & splat_wide(sibling, _LANES)) + multiply_high(row, splat_wide(tree.share[k], _LANES))
        if k > 0:
            store_wide(sums, np.int64(parent) * UNIT, children)
        parent_before = parent


@kernel
def _root_to_volume(tree: _Tree, sums: Uint16, inside: tuple[int, int], stride: int, volume: Uint8) -> None:
    """A of each node, scaled to LARGEST; those of the stripe's own pixels go to the volume, `stride` bytes a pixel."""
    scale, half = splat_wide(np.uint16(LARGEST * 257), _LANES), splat_wide(np.uint16(128), _LANES)
    for k in range(tree.nodes):
        g = tree.down[k]
        rest = np.uint16(65535 - g)
        row = (multiply_high(load_wide(sums, np.int64(tree.parent[k]) * UNIT, _LANES), splat_wide(g, _LANES))
               + multiply_high(load_wide(sums, k * UNIT, _LANES), splat_wide(rest, _LANES)))
        store_wide(sums, k * UNIT, row)
        pixel = np.int64(tree.pixel[k])
        if inside[0] <= pixel < inside[1]:
            value = narrow_wide(shift_right(multiply_high(row, scale) + half, 8))
            store_wide(volume, (pixel - inside[0]) * stride, value)


class TreeAggregation(StripeAggregation):
    """Support along the minimum spanning tree of each stripe."""

    pixel_cost = PIXEL_COST
    full_cost = LARGEST

    def __init__(self, view: View) -> None:
        super().__init__(view)
        self._stripes = stripe_count(view.rows)
        self._trees = empty_trees(self._stripes, view.rows)

    def phases(self, costs: ByteCosts, pair: Pair, parameters: MatcherParameters) -> list[Phase]:
        similarities = edge_similarities(parameters.sigma_tree, parameters.d_y, float(pair.images.level_unit))
        rows, number, scratch = self.view.rows, self.view.number, scratch_size(self.view.rows)
        return [Phase('spanning_forest', self._stripes, build_stripe_trees,
                      (self._trees, rows, number, pair.tree_edges, similarities), scratch),
                Phase('cost_aggregation', self._stripes * (self.view.lanes // UNIT), aggregate_blocks,
                      (self._trees, rows, number, costs, self.volume), scratch)]
