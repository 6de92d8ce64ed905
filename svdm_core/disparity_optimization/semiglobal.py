"""Stage 3, semi-global: costs smoothed along scanlines from several directions before the winner takes all.

L(p, d) = C(p, d) + min(L(q, d), L(q, d +- 1) + P1, min L(q) + P2(q, p)) - min L(q), q the pixel before p
(Hirschmueller 2008), summed over the paths from the left, the right, above and, if wanted, below. Costs are uint16,
scaled so that no sum overflows; the disparities of a pixel lie side by side, filled up to whole vectors with the
largest cost.

Rows are worked on from top to bottom, a few at a time so that they stay in the cache and that the vector
instructions of one row need not wait for those of its left neighbour. Only the path from below needs a volume.
"""
from __future__ import annotations

import numba
import numpy as np

from ..cost_aggregation.tree import ForestNodes
from ..kernels.arrays import Float32, Int16, Int32, Uint16, UInt64
from ..kernels.compilation import kernel
from ..kernels.vectors import (
    count_ones,
    first_equal,
    half_splat,
    least,
    load,
    lower_neighbours,
    minimum,
    narrow,
    pointer,
    splat,
    store,
    to_uint16,
    upper_neighbours,
)
from ..matching_cost.planes import BLOCK, INTENSITY, CostScale, MatchingPlanes, cost_scale, cost_terms, cost_vector
from ..parameters import MatcherParameters
from .penalties import FROM_ABOVE, FROM_LEFT

# Disparities in one vector.
LANES = 32

# Four path costs of this size still fit into 16 bits.
LARGEST = 2**14 - 1

# Rows worked on at a time.
_ROWS = 4


def padded(num_disparities: int) -> int:
    """Disparities stored for each pixel: whole vectors."""
    return -(-num_disparities // LANES) * LANES


def scratch_size(width: int, num_disparities: int) -> int:
    """Elements of scratch that one view of images of this width needs."""
    stride = padded(num_disparities)
    return (width + _ROWS) * (stride + 2 * LANES) + (2 * _ROWS + 4) * width * stride + padded(3 * width)


def cost_factor(parameters: MatcherParameters) -> float:
    """What the costs of `cost_vector` are multiplied by: a pixel's aggregated cost and P2 together stay in 14 bits."""
    *_, bit, largest = map(float, cost_scale(parameters))
    factor = (LARGEST - 2 * _summed(parameters)) / (_summed(parameters) * max(largest + parameters.p2 * INTENSITY, 1.0))
    if cost_terms(parameters) == (False, True) and bit * factor >= 1:
        return int(bit * factor) / bit  # a whole number for each bit: `_cost_row` need not round
    return factor


def semiglobal_winners(
    nodes: ForestNodes, planes: MatchingPlanes, parameters: MatcherParameters, shape: tuple[int, int], volume: Uint16,
    below: Uint16, scratch: Uint16, penalties: Uint16,
) -> tuple[Int32, Float32]:
    """Smooth both views and take the winners; returns what `Winners.images` does.

    nodes: in the order of the pixels, from which box aggregation takes its costs. volume: uint16 (2, N * stride),
    stride of `padded`, holds the costs of tree aggregation; scratch for box aggregation with the path from below,
    else (2, 0). below: scratch of that shape where there is that path, else (2, 0).
    scratch: uint16 (2, `scratch_size`). penalties: of `fill_penalties` with `scaled_penalties`.
    """
    winner = np.empty((2, *shape), np.int32)
    vertex = np.zeros(shape, np.float32)
    factor = cost_factor(parameters)
    _smooth(nodes.own, nodes.own_census, nodes.partner, planes.values.reshape(2, -1), planes.census.reshape(2, -1),
            planes.values.shape[1], planes.values[0, 0].size, cost_scale(parameters), cost_terms(parameters),
            parameters.min_disparity, parameters.num_disparities, np.float32(factor), volume, below, scratch, *shape,
            padded(parameters.num_disparities), np.uint16(scaled_penalties(parameters)[0]), penalties,
            parameters.aggregation == 'box', winner.reshape(2, -1),
            vertex.reshape(-1) if parameters.subpixel else vertex.reshape(-1)[:0])
    return winner, vertex


def scaled_penalties(parameters: MatcherParameters) -> tuple[int, int]:
    """P1, at most P2, and P2 in the unit of the path costs."""
    unit = INTENSITY * _summed(parameters) * cost_factor(parameters)
    return round(min(parameters.p1, parameters.p2) * unit), round(parameters.p2 * unit)


def _summed(parameters: MatcherParameters) -> int:
    """Matching costs that make up an aggregated one, as it is stored."""
    return 9 if parameters.aggregation == 'box' else 1


@kernel(parallel=True)
def _smooth(
    own: Float32, own_census: UInt64, partner: Int32, values: Int16, census: UInt64, planes: int, size: int,
    scale: CostScale, terms: tuple[bool, bool], first: int, disparities: int, factor: np.float32, volume: Uint16,
    below: Uint16, scratch: Uint16, height: int, width: int, stride: int, p1: np.uint16, penalties: Uint16,
    box: bool, winner: Int32, vertex: Float32,
) -> None:
    barrier = np.zeros(stride, np.uint16)
    barrier[disparities:] = 65535
    behind = np.full(stride, np.float32(0.5))  # rounds; makes anything the largest behind the search range
    behind[disparities:] = 1e9
    for view in numba.prange(2):
        source = (own[view], own_census[view], partner[view], values[1 - view], census[1 - view], planes, size, scale,
                  terms, first, disparities, behind, factor)
        room, row = stride + 2 * LANES, width * stride
        line, rest = scratch[view, :width * room], scratch[view, width * room:]
        rows_line, rest = rest[:_ROWS * room], rest[_ROWS * room:]
        costs, total, rest = rest[:_ROWS * row], rest[_ROWS * row:2 * _ROWS * row], rest[2 * _ROWS * row:]
        raw, ring, beside = rest[:row], rest[row:4 * row].reshape(3, row), rest[4 * row:4 * row + 3 * width]
        if box and volume.size:
            _fill_volume(source, height, width, stride, raw, ring, volume[view])
        if below.size:
            _paths_from_below(volume[view], height, width, stride, p1, penalties[view], line, below[view])
        _smooth_view(source, volume[view], below[view], height, width, stride, disparities, p1, penalties[view], line,
                     rows_line, costs, total, raw, ring, beside, barrier, winner[view],
                     vertex if view == 0 else vertex[:0])


@kernel
def _advance(line, at, cost, here, total, there, add, low, p1, p2, chunks):  # type: ignore[no-untyped-def]
    """One pixel of one path: L of the pixel before becomes this pixel's, in place; returns its minimum.

    line: pointer to L from `at` on, at least a vector of large values on either side. cost, total: pointers to this
    pixel's costs from `here`, and to the sums over paths from `there` on, set or added to. low: min L of before.
    """
    smooth, before = splat(p1), splat(low)
    jump = before + splat(p2)
    smallest = splat(np.uint16(65535))
    last, same = splat(np.uint16(LARGEST)), load(line, at)
    for c in range(chunks):
        o = c * LANES
        following = load(line, at + o + LANES)
        beside = minimum(lower_neighbours(last, same), upper_neighbours(same, following))
        new = load(cost, here + o) + (minimum(minimum(same, beside + smooth), jump) - before)
        store(line, at + o, new)
        store(total, there + o, load(total, there + o) + new if add else new)
        smallest = minimum(smallest, new)
        last, same = same, following
    return least(smallest)


@kernel
def _winner(total, there, more, at, from_below, barrier, chunks):  # type: ignore[no-untyped-def]
    """(sum, disparity) of the smallest sum of a pixel; adds the path from below first where there is one."""
    smallest = splat(np.uint16(65535))
    for c in range(chunks):
        o = c * LANES
        value = load(total, there + o)
        if from_below:
            value = value + load(more, at + o)
            store(total, there + o, value)
        smallest = minimum(smallest, value | load(barrier, o))
    least_sum = least(smallest)
    winner = np.int32(0)
    for c in range(chunks - 1, -1, -1):  # no branch that could not be foreseen
        lane = first_equal(load(total, there + c * LANES), least_sum)
        winner = np.int32(c * LANES + lane) if lane < LANES else winner
    return least_sum, winner


@kernel
def _cost_row(source, y, height, width, stride, into):  # type: ignore[no-untyped-def]
    """Matching costs of row y, scaled, into uint16 (width * stride); behind the search range the largest."""
    own, own_census, partner, values, census, planes, size, scale, terms, first, disparities, behind, factor = source
    own_at, own_census_at, values_at, census_at, at, behind_at = (
        pointer(own), pointer(own_census), pointer(values), pointer(census), pointer(into), pointer(behind))
    largest = splat(np.float32(scale[4] * factor + np.float32(0.5)))
    whole_bits = terms[1] and not terms[0] and scale[3] * factor > np.float32(0.99)  # as `cost_factor` made them
    bit = np.uint16(scale[3] * factor + np.float32(0.5)) if whole_bits else np.uint16(0)
    pitch = size // height
    for x in range(width):
        k = y * width + x
        start = partner[k] + first
        inside = min(disparities, width - (start - y * pitch)) if bit > 0 else 0
        whole = max(inside, 0) // BLOCK * BLOCK
        own_bits = splat(own_census[k]) if bit > 0 else splat(np.uint64(0))
        for d in range(0, whole, BLOCK):  # nothing but census, and all partners in the image: whole numbers
            store(at, x * stride + d, narrow(count_ones(own_bits ^ load(census_at, start + d))) * half_splat(bit))
        for d in range(whole, stride, BLOCK):
            cost = cost_vector(own_at, own_census_at, k, values_at, census_at, terms, planes, size, start + d, scale)
            scaled = cost * splat(factor) + load(behind_at, d)
            store(at, x * stride + d, to_uint16(minimum(scaled, largest)))


@kernel
def _add_beside(row, into, width, stride):  # type: ignore[no-untyped-def]
    """into[x] = row[x - 1] + row[x] + row[x + 1], the borders replicated."""
    at, to = pointer(row), pointer(into)
    for x in range(width):
        left, right = max(x - 1, 0) * stride, min(x + 1, width - 1) * stride
        for o in range(0, stride, LANES):
            store(to, x * stride + o, load(at, left + o) + load(at, x * stride + o) + load(at, right + o))


@kernel
def _box_row(source, y, height, width, stride, raw, ring, into):  # type: ignore[no-untyped-def]
    """Sum of the matching costs of the 3x3 pixels around each pixel of row y; rows must come from 0 on, one by one."""
    for new in range(0 if y == 0 else y + 1, min(y + 2, height)):
        _cost_row(source, new, height, width, stride, raw)
        _add_beside(raw, ring[new % 3], width, stride)
    above, here, below = pointer(ring[max(y - 1, 0) % 3]), pointer(ring[y % 3]), pointer(ring[(y + 1) % 3])
    below = here if y == height - 1 else below
    to = pointer(into)
    for o in range(0, width * stride, LANES):
        store(to, o, load(above, o) + load(here, o) + load(below, o))


@kernel
def _along_rows(cost, at, total, rows, width, stride, p1, penalty, line):  # type: ignore[no-untyped-def]
    """Paths from the left and from the right over a few rows of costs (from `at` on), summed into total.

    penalty: FROM_LEFT of these rows, and one more.
    """
    room = stride + 2 * LANES
    chunks = stride // LANES
    cost_at, total_at, line_at = pointer(cost), pointer(total), pointer(line)
    low = np.zeros(rows, np.uint16)
    for backwards in range(2):
        _clear_line(line, rows, stride)
        low[:] = 0
        for step in range(width):
            x = width - 1 - step if backwards else step
            for r in range(rows):
                here = (r * width + x) * stride
                low[r] = _advance(line_at, r * room + LANES, cost_at, at + here, total_at, here, backwards == 1,
                                  low[r], p1, penalty[r * width + x + backwards], chunks)


@kernel
def _clear_line(line, pixels, stride):  # type: ignore[no-untyped-def]
    """Zeros for `pixels` pixels, with a vector of large values before and after each."""
    room = stride + 2 * LANES
    for k in range(pixels):
        line[k * room:(k + 1) * room] = LARGEST
        line[k * room + LANES:k * room + LANES + stride] = 0


@kernel
def _fill_volume(source, height, width, stride, raw, ring, volume):  # type: ignore[no-untyped-def]
    for y in range(height):
        into = volume[y * width * stride:(y + 1) * width * stride]
        _box_row(source, y, height, width, stride, raw, ring, into)


@kernel
def _paths_from_below(volume, height, width, stride, p1, penalties, line, into):  # type: ignore[no-untyped-def]
    room, chunks = stride + 2 * LANES, stride // LANES
    low = np.zeros(width, np.uint16)
    _clear_line(line, width, stride)
    line_at, volume_at, into_at = pointer(line), pointer(volume), pointer(into)
    penalty = penalties[FROM_ABOVE]
    for y in range(height - 1, -1, -1):
        for x in range(width):
            here = (y * width + x) * stride
            low[x] = _advance(line_at, x * room + LANES, volume_at, here, into_at, here, False, low[x], p1,
                              penalty[(y + 1) * width + x], chunks)


@kernel
def _smooth_view(  # type: ignore[no-untyped-def]
    source, volume, below, height, width, stride, disparities, p1, penalties, line, rows_line, costs, total, raw, ring,
    beside, barrier, winner, vertex,
):
    """All paths of one view; winner int32 (N,), vertex float32 (N,) or empty.

    source: what `_cost_row` needs. volume, below: uint16 (N * stride) aggregated costs and sums of the path from
    below, or empty: then costs are computed row by row, or there is no such path. penalties: uint16 (2, N + W).
    line, rows_line, costs, total, raw, ring, beside: scratch. barrier: uint16 (stride), 65535 behind the search range,
    else 0.
    """
    room, chunks = stride + 2 * LANES, stride // LANES
    low = np.zeros(width, np.uint16)
    winner_at, beside_at = pointer(winner), pointer(beside)
    _clear_line(line, width, stride)
    total_at, line_at, below_at, barrier_at = pointer(total), pointer(line), pointer(below), pointer(barrier)
    stored, from_below, subpixel = volume.size > 0, below.size > 0, vertex.size > 0
    from_above = penalties[FROM_ABOVE]
    for y in range(0, height, _ROWS):
        rows = min(_ROWS, height - y)
        if not stored:
            for r in range(rows):
                into = costs[r * width * stride:(r + 1) * width * stride]
                _box_row(source, y + r, height, width, stride, raw, ring, into)
        cost, at = (volume, y * width * stride) if stored else (costs, 0)
        _along_rows(cost, at, total, rows, width, stride, p1, penalties[FROM_LEFT, y * width:], rows_line)
        cost_at = pointer(cost)
        for r in range(rows):
            for x in range(width):
                here = (r * width + x) * stride
                low[x] = _advance(line_at, x * room + LANES, cost_at, at + here, total_at, here, True, low[x], p1,
                                  from_above[(y + r) * width + x], chunks)
            # A loop of its own: what was just stored is slow to load.
            for x in range(width):
                here, pixel = (r * width + x) * stride, (y + r) * width + x
                lowest, d = _winner(total_at, here, below_at, pixel * stride, from_below, barrier_at, chunks)
                winner_at[pixel] = d
                if subpixel:
                    beside_at[x] = total_at[here + max(d - 1, 0)]
                    beside_at[width + x] = lowest
                    beside_at[2 * width + x] = total_at[here + min(d + 1, stride - 1)]
            if subpixel:
                pixels = slice((y + r) * width, (y + r + 1) * width)
                _vertices(beside.reshape(3, width), winner[pixels], disparities - 1, vertex[pixels])


@kernel
def _vertices(beside, winner, end, vertex):  # type: ignore[no-untyped-def]
    """vertex[x]: `symmetric_v` of the sums beside[0 .. 2, x], 0 at either end of the search range."""
    cost_below, cost_here, cost_above = beside[0], beside[1], beside[2]
    for x in range(winner.size):
        below, lowest, above = np.float32(cost_below[x]), np.float32(cost_here[x]), np.float32(cost_above[x])
        inside = np.float32(winner[x] > 0) * np.float32(winner[x] < end)
        slope = max(max(below, above) - lowest, np.float32(1))  # sums are whole numbers
        vertex[x] = inside * (np.float32(0.5) * (below - above) / slope)
