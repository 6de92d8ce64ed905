"""Stage 1 in float32, for the exact tree: what two pixels cost (eqs 1-8), at BLOCK disparities at once.

A node is a pixel in the order of its tree; its values are gathered once, as the passes over the tree jump about.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..kernels.arrays import Float32, Int16, Int32, Int64, Uint8
from ..kernels.compilation import kernel
from ..kernels.tasks import do_tasks, share
from ..kernels.vectors import absolute, count_ones, load, minimum, pointer, splat, to_float, where_equal
from ..parameters import MatcherParameters
from .byte_costs import has_differences
from .census import BITS, NIBBLES
from .planes import INTENSITY, NOTHING, MatchingPlanes

BLOCK = 16
"""Disparities worked on at a time by one thread: one vector, and one cache line a node."""

_OWN_NIBBLES = 16
"""Bytes that a node's census takes, so that it lies in one cache line."""

_CHUNK = 4096  # nodes gathered by one task


class CostScale(NamedTuple):
    """The parameters of stage 1 in units of the planes; bit: weight of one bit of the census."""

    tau_ad: np.float32
    tau_gm: np.float32
    alpha: np.float32
    bit: np.float32
    largest: np.float32
    has_differences: bool
    has_census: bool
    min_disparity: int


def cost_scale(parameters: MatcherParameters) -> CostScale:
    """The parameters of stage 1 in units of the planes."""
    tau_ad, tau_gm = parameters.tau_ad * INTENSITY, parameters.tau_gm * INTENSITY
    weight = parameters.census_weight * INTENSITY
    largest = tau_ad + parameters.alpha * tau_gm + weight
    return CostScale(np.float32(tau_ad), np.float32(tau_gm), np.float32(parameters.alpha), np.float32(weight / BITS),
                     np.float32(largest), has_differences(parameters), parameters.census_weight > 0,
                     parameters.min_disparity)


class NodeValues(NamedTuple):
    """What stage 1 needs of each view's nodes, and the planes that hold their partners; flat for parallel kernels.

    partner, census_partner: int32 (2, N), flat index of the partner at disparity 0 in the other view's planes.
    own: float32 (2, N * (C + 1)); own_census: uint8 (2, N * 16) or (2, 0). values, census: of `MatchingPlanes`.
    """

    partner: Int32
    census_partner: Int32
    own: Float32
    own_census: Uint8
    values: Int16
    census: Uint8
    before: int


def empty_values(planes: MatchingPlanes, nodes: int) -> NodeValues:
    """Room for two views of `nodes` nodes each, whose values come from such planes."""
    bytes_ = nodes * _OWN_NIBBLES if planes.census.shape[1] else 0
    partner, census_partner = np.zeros((2, 2, nodes), np.int32)
    return NodeValues(partner, census_partner, np.zeros((2, nodes * planes.values.shape[1]), np.float32),
                      np.zeros((2, bytes_), np.uint8), planes.values, planes.census, planes.before)


def gather_values(nodes: NodeValues, pixel: Int32, width: int) -> None:
    """Of the nodes of two trees, pixel int32 (2, N), W = width."""
    do_tasks(_gather_chunks, 2 * -(-pixel.shape[1] // _CHUNK), nodes, pixel, width)


@kernel
def _gather_chunks(
    counter: Int64, end: int, arenas: Uint8, nodes: NodeValues, pixel: Int32, width: int
) -> None:
    share(_gather_chunk, counter, end, arenas, (nodes, pixel, width))


@kernel
def _gather_chunk(task: int, _arena: Uint8, nodes: NodeValues, pixel: Int32, width: int) -> None:
    chunks = -(-pixel.shape[1] // _CHUNK)
    view, chunk = task // chunks, task % chunks
    planes, pitch = nodes.values.shape[1], nodes.values.shape[3]
    for k in range(chunk * _CHUNK, min(pixel.shape[1], (chunk + 1) * _CHUNK)):
        y, x = pixel[view, k] // width, pixel[view, k] % width
        at = nodes.before + width - 1 - x
        nodes.partner[view, k] = y * pitch + at
        nodes.census_partner[view, k] = y * NIBBLES * pitch + at
        for c in range(planes):
            nodes.own[view, k * planes + c] = np.float32(nodes.values[view, c, y, nodes.before + x])
        if nodes.own_census.shape[1] > 0:
            for n in range(NIBBLES):
                nodes.own_census[view, k * _OWN_NIBBLES + n] = nodes.census[view, y, n, nodes.before + x]


class ViewPointers(NamedTuple):
    """`NodeValues` of one view as pointers, for `cost_vector`; size: of one plane of values."""

    partner: Any
    census_partner: Any
    own: Any
    own_census: Any
    values: Any
    census: Any
    planes: int
    size: int
    pitch: int


@kernel
def view_pointers(nodes: NodeValues, view: int) -> ViewPointers:
    """One view's nodes and the other view's planes."""
    values = nodes.values[1 - view]
    planes, height, pitch = values.shape
    return ViewPointers(pointer(nodes.partner[view]), pointer(nodes.census_partner[view]), pointer(nodes.own[view]),
                        pointer(nodes.own_census[view]), pointer(values), pointer(nodes.census[1 - view]), planes,
                        height * pitch, pitch)


@kernel
def cost_vector(view: ViewPointers, k: int, first: int, scale: CostScale) -> Any:
    """Costs of node k, a vector over BLOCK disparities from min_disparity + first on (eq 8), unit 1 / INTENSITY."""
    start, node = view.partner[k] + scale.min_disparity + first, k * view.planes
    slope = load(view.values, (view.planes - 1) * view.size + start)
    cost = splat(np.float32(0))
    if scale.has_differences:
        difference = absolute(splat(view.own[node]) - to_float(load(view.values, start)))
        if view.planes == 4:
            second = absolute(splat(view.own[node + 1]) - to_float(load(view.values, view.size + start)))
            third = absolute(splat(view.own[node + 2]) - to_float(load(view.values, 2 * view.size + start)))
            difference = (difference + second + third) * splat(np.float32(1 / 3))
        slope_difference = absolute(splat(view.own[node + view.planes - 1]) - to_float(slope))
        cost = (minimum(difference, splat(scale.tau_ad))
                + splat(scale.alpha) * minimum(slope_difference, splat(scale.tau_gm)))
    if scale.has_census:
        at, own = view.census_partner[k] + scale.min_disparity + first, k * _OWN_NIBBLES
        distance = count_ones(splat(view.own_census[own]) ^ load(view.census, at))
        for n in range(1, NIBBLES):
            distance = distance + count_ones(splat(view.own_census[own + n]) ^ load(view.census, at + n * view.pitch))
        cost = cost + splat(scale.bit) * to_float(distance)
    return where_equal(slope, splat(NOTHING), splat(scale.largest), cost)
