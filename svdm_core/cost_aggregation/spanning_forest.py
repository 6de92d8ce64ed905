"""The minimum spanning forest that carries the support of stage 2 (eqs 9-11), laid out for streaming.

The nodes are the 4-connected pixels, an edge weighs the largest channel difference of its two pixels in
grey levels. Cutting at d_y (eq 10) needs no second structure: a cut edge passes no support, see
`cost_aggregation.edge_similarity`.
"""
from __future__ import annotations

import dataclasses

import numpy as np

from ..kernels.arrays import Image, Int32, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.tasks import do_tasks, share
from ..matching_cost.edges import raise_to_differences

RIGHT, LEFT, DOWN, UP = np.uint8(1), np.uint8(2), np.uint8(4), np.uint8(8)

# Nodes that `_breadth_first` may write behind the last one.
SPARE = 3


@dataclasses.dataclass(frozen=True, slots=True)
class SpanningTrees:
    """Minimum spanning trees of two guides, each in breadth-first order, and the scratch to build them.

    Each (2, N) with N = H * W:
    pixel: int32, flat pixel index (y * width + x) of node k; node 0 is the root, pixel 0.
    parent: int32, node index of node k's parent, < k and non-decreasing; parent[0] = 0.
    weight: uint8, weight of the edge to the parent, grey levels; weight[0] = 0.
    Among edges of equal weight the first, row by row, is taken first.
    """

    pixel: Int32
    parent: Int32
    weight: Uint8
    _room: Int32
    _links: Uint8
    _weights: Uint8

    @classmethod
    def empty(cls, shape: tuple[int, ...]) -> SpanningTrees:
        """Room for the trees of guides of `shape`, (H, W) or (H, W, C)."""
        height, width = shape[:2]
        nodes = height * width
        room = np.zeros((2, 2, nodes + SPARE), np.int32)
        return cls(room[:, 0, :nodes], room[:, 1, :nodes], np.zeros((2, nodes), np.uint8), room,
                   np.zeros((2, 2, nodes + SPARE), np.uint8), np.zeros((2, 2, height, width), np.uint8))

    def build(self, left: Image, right: Image, scratch: Int32 | None = None, step: float = 1.0) -> None:
        """From two guides, uint8 or uint16, (H, W) or (H, W, C). step: grey levels in one unit of weight.

        scratch: int32 (2, 3 N or more), made where there is none.
        """
        if scratch is None:
            scratch = np.empty((2, 3 * self.weight.shape[1]), np.int32)
        height, width = left.shape[:2]
        planes = np.empty((2, left.size // (height * width), height, width), left.dtype)  # one layout, one kernel
        for view, guide in enumerate((left, right)):
            planes[view] = np.moveaxis(guide.reshape(height, width, -1), 2, 0)
        do_tasks(_fill_weights, 2, planes, np.float32(1 / step), self._weights)
        do_tasks(_spanning_trees, 2, self._room, self.weight, scratch, self._links, self._weights)


@kernel
def _fill_weights(
    counter: Int64, end: int, arenas: Uint8, planes: Image, per_level: np.float32, weights: Uint8
) -> None:
    share(_fill_weights_of, counter, end, arenas, (planes, per_level, weights))


@kernel
def _fill_weights_of(view: int, _arena: Uint8, planes: Image, per_level: np.float32, weights: Uint8) -> None:
    """weights[view, 0], [view, 1]: of the edge to the pixel on the right, below: the largest channel difference."""
    weights[view] = 0
    height = planes.shape[2]
    for c in range(planes.shape[1]):
        for y in range(height):
            row = planes[view, c, y]
            raise_to_differences(row[:-1], row[1:], per_level, weights[view, 0, y])
            if y < height - 1:
                raise_to_differences(row, planes[view, c, y + 1], per_level, weights[view, 1, y])


@kernel
def _sort_edges(across: Uint8, down: Uint8, edges: Int32) -> int:
    """Edges by weight, ties in row order (counting sort); an edge is 2 * pixel, + 1 when it goes down.

    Returns their number.
    """
    height, width = across.shape
    start = np.zeros(257, np.int32)
    for y in range(height):
        for x in range(width - 1):
            start[np.int32(across[y, x]) + 1] += 1
        if y < height - 1:
            for x in range(width):
                start[np.int32(down[y, x]) + 1] += 1
    for level in range(256):
        start[level + 1] += start[level]
    count = start[256]
    for y in range(height):
        for x in range(width):
            pixel = y * width + x
            if x < width - 1:
                w = np.int32(across[y, x])
                edges[start[w]] = 2 * pixel
                start[w] += 1
            if y < height - 1:
                w = np.int32(down[y, x])
                edges[start[w]] = 2 * pixel + 1
                start[w] += 1
    return int(count)


@kernel
def _root(above: Int32, node: np.int32) -> np.int32:
    while above[node] != node:
        above[node] = above[above[node]]
        node = above[node]
    return node


@kernel
def _link_tree(edges: Int32, width: int, above: Int32, links: Uint8) -> None:
    """Kruskal: for each pixel the directions (RIGHT | LEFT | DOWN | UP) in which the tree goes on."""
    links[:] = 0
    for pixel in range(above.size):
        above[pixel] = pixel
    missing = above.size - 1
    for edge in edges:
        a = edge >> 1
        b = a + width if edge & 1 else a + 1
        root_a, root_b = _root(above, a), _root(above, b)
        if root_a != root_b:
            above[max(root_a, root_b)] = min(root_a, root_b)
            if edge & 1:
                links[a] |= DOWN
                links[b] |= UP
            else:
                links[a] |= RIGHT
                links[b] |= LEFT
            missing -= 1
            if missing == 0:
                break


@kernel
def _breadth_first(links: Uint8, width: int, pixel: Int32, parent: Int32, back: Uint8) -> None:
    """Number the nodes from pixel 0 on; back[k]: the direction from node k to its parent, 0 for the root.

    Every direction is written and only the real ones counted, as branches here cannot be foreseen: pixel, parent
    and back need room for 3 nodes more.
    """
    pixel[0] = parent[0] = back[0] = 0
    end = np.int64(1)
    for node in range(links.size):
        p = pixel[node]
        onwards = np.int64(links[p]) & ~np.int64(back[node])
        pixel[end], parent[end], back[end] = p + 1, node, LEFT
        end += onwards & 1
        pixel[end], parent[end], back[end] = p - 1, node, RIGHT
        end += onwards >> 1 & 1
        pixel[end], parent[end], back[end] = p + width, node, UP
        end += onwards >> 2 & 1
        pixel[end], parent[end], back[end] = p - width, node, DOWN
        end += onwards >> 3 & 1


@kernel
def _weights_to_parents(pixel: Int32, back: Uint8, weights: Uint8, width: int, weight: Uint8) -> None:
    """weight[k] from the weights of all edges, uint8 (2 * N): across, then down."""
    edge = np.zeros(16, np.int64)  # by direction, from the pixel
    edge[RIGHT], edge[LEFT], edge[DOWN], edge[UP] = 0, -1, weight.size, weight.size - width
    weight[0] = 0
    for k in range(1, weight.size):
        weight[k] = weights[pixel[k] + edge[back[k]]]


@kernel
def _spanning_trees(
    counter: Int64, end: int, arenas: Uint8, room: Int32, weight: Uint8, scratch: Int32, links: Uint8, weights: Uint8
) -> None:
    share(_spanning_tree, counter, end, arenas, (room, weight, scratch, links, weights))


@kernel
def _spanning_tree(
    view: int, _arena: Uint8, room: Int32, weight: Uint8, scratch: Int32, links: Uint8, weights: Uint8
) -> None:
    build_tree(room[view], weight[view], scratch[view], links[view], weights[view])


@kernel
def build_tree(room: Int32, weight: Uint8, scratch: Int32, links: Uint8, weights: Uint8) -> None:
    """room: pixel and parent; links: links and the directions back to the parent."""
    nodes, width = weight.size, weights.shape[2]
    edges, above = scratch[:2 * nodes], scratch[2 * nodes:3 * nodes]
    across, down = weights[0], weights[1]
    count = _sort_edges(across, down, edges)
    _link_tree(edges[:count], width, above, links[0, :nodes])
    _breadth_first(links[0, :nodes], width, room[0], room[1], links[1])
    _weights_to_parents(room[0], links[1], weights.reshape(-1), width, weight)
