"""The minimum spanning forest that carries the support of stage 2 (eqs 9-11), laid out for streaming.

The nodes are the 4-connected pixels, an edge weighs the largest channel difference of its two pixels in
grey levels. Cutting at d_y (eq 10) needs no second structure: a cut edge passes no support, see
`cost_aggregation.edge_similarity`.
"""
from __future__ import annotations

import numba
import numpy as np

from .arrays import Int32, Uint8

RIGHT, LEFT, DOWN, UP = np.uint8(1), np.uint8(2), np.uint8(4), np.uint8(8)


def minimum_spanning_trees(
    left: Uint8, right: Uint8
) -> tuple[Int32, Int32, Uint8]:
    """Minimum spanning trees of two guides, uint8 (H, W) or (H, W, C), each in breadth-first order.

    Returns, each (2, N) with N = H * W:
    pixel: int32, flat pixel index (y * width + x) of node k; node 0 is the root, pixel 0.
    parent: int32, node index of node k's parent, < k and non-decreasing; parent[0] = 0.
    weight: uint8, weight of the edge to the parent, grey levels; weight[0] = 0.
    Among edges of equal weight the first, row by row, is taken first.
    """
    height, width = left.shape[:2]
    planes = np.stack([np.moveaxis(guide.reshape(height, width, -1), 2, 0) for guide in (left, right)])
    pixel, parent = np.empty((2, 2, height * width), np.int32)
    weight = np.empty((2, height * width), np.uint8)
    _spanning_trees(planes, pixel, parent, weight)
    return pixel, parent, weight


@numba.njit(cache=True)
def _edge_weights(planes: Uint8, across: Uint8, down: Uint8) -> None:
    """across[y, x], down[y, x]: largest channel difference to the pixel on the right, below."""
    channels, height, width = planes.shape
    for y in range(height):
        for x in range(width - 1):
            across[y, x] = abs(np.int32(planes[0, y, x]) - np.int32(planes[0, y, x + 1]))
        for c in range(1, channels):
            for x in range(width - 1):
                difference = abs(np.int32(planes[c, y, x]) - np.int32(planes[c, y, x + 1]))
                across[y, x] = max(across[y, x], np.uint8(difference))
    for y in range(height - 1):
        for x in range(width):
            down[y, x] = abs(np.int32(planes[0, y, x]) - np.int32(planes[0, y + 1, x]))
        for c in range(1, channels):
            for x in range(width):
                difference = abs(np.int32(planes[c, y, x]) - np.int32(planes[c, y + 1, x]))
                down[y, x] = max(down[y, x], np.uint8(difference))


@numba.njit(cache=True)
def _sorted_edges(across: Uint8, down: Uint8) -> Int32:
    """Edges by weight, ties in row order (counting sort); an edge is 2 * pixel, + 1 when it goes down."""
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
    edges = np.empty(start[256], np.int32)
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
    return edges


@numba.njit(cache=True, inline='always')
def _root(above: Int32, node: np.int32) -> np.int32:
    while above[node] != node:
        above[node] = above[above[node]]
        node = above[node]
    return node


@numba.njit(cache=True)
def _tree_links(edges: Int32, n: int, width: int) -> Uint8:
    """Kruskal: for each pixel the directions (RIGHT | LEFT | DOWN | UP) in which the tree goes on."""
    above = np.arange(n).astype(np.int32)
    links = np.zeros(n, np.uint8)
    missing = n - 1
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
    return links


@numba.njit(cache=True)
def _breadth_first(links: Uint8, across: Uint8, down: Uint8, pixel: Int32, parent: Int32, weight: Uint8) -> None:
    width = across.shape[1]
    pixel[0] = parent[0] = weight[0] = 0
    end = 1
    for node in range(links.size):
        p = pixel[node]
        link = links[p]
        if link & RIGHT:
            pixel[end], parent[end], weight[end] = p + 1, node, across[p // width, p % width]
            links[p + 1] ^= LEFT
            end += 1
        if link & LEFT:
            pixel[end], parent[end], weight[end] = p - 1, node, across[(p - 1) // width, (p - 1) % width]
            links[p - 1] ^= RIGHT
            end += 1
        if link & DOWN:
            pixel[end], parent[end], weight[end] = p + width, node, down[p // width, p % width]
            links[p + width] ^= UP
            end += 1
        if link & UP:
            pixel[end], parent[end], weight[end] = p - width, node, down[p // width - 1, p % width]
            links[p - width] ^= DOWN
            end += 1


@numba.njit(cache=True, parallel=True)
def _spanning_trees(planes: Uint8, pixel: Int32, parent: Int32, weight: Uint8) -> None:
    for view in numba.prange(planes.shape[0]):
        _spanning_tree(planes[view], pixel[view], parent[view], weight[view])


@numba.njit(cache=True)
def _spanning_tree(planes: Uint8, pixel: Int32, parent: Int32, weight: Uint8) -> None:
    _, height, width = planes.shape
    across, down = np.empty((height, width), np.uint8), np.empty((height, width), np.uint8)
    _edge_weights(planes, across, down)
    links = _tree_links(_sorted_edges(across, down), height * width, width)
    _breadth_first(links, across, down, pixel, parent, weight)
