"""Stage 1 in bytes: what two pixels cost (eqs 1-8), for a pixel at all disparities of a vector at once.

Each term is truncated and scaled in 16 bits, and their sum is rounded to 8, the largest cost there is to `largest`.
"""
from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ..kernels.arrays import Int16, Uint8
from ..kernels.compilation import kernel
from ..kernels.instructions import differing_bits, multiply_high
from ..kernels.vectors import pointer
from ..kernels.wide import (
    UNIT,
    Lanes,
    absolute_difference,
    load_wide,
    maximum_wide,
    minimum_wide,
    narrow_wide,
    shift_right,
    splat_wide,
    widen,
)
from ..parameters import MatcherParameters
from . import census
from .planes import INTENSITY, MatchingPlanes

_NIBBLES = census.NIBBLES

_FRACTION = 7
"""Bits behind the point of the 16-bit sums; with them the largest byte fits, and there is room for the rounding."""


class ByteCosts(NamedTuple):
    """All that the costs of both views are computed from; flat, so that parallel kernels take it.

    values, census, before: of `MatchingPlanes`. start: the first disparity. outside: uint8 (pitch), `largest` in the
    columns without pixels, else 0. behind: uint8 (search range in whole vectors), `largest` behind the range, else 0.
    The rest are the terms' truncations, what widens them to 16 bits, and their weights (see `_term`).
    """

    values: Int16
    census: Uint8
    before: int
    start: int
    outside: Uint8
    behind: Uint8
    has_differences: bool
    tau_ad: np.uint16
    widen_ad: np.uint16
    weight_ad: np.uint16
    tau_gm: np.uint16
    widen_gm: np.uint16
    weight_gm: np.uint16
    bit: np.uint16


def has_differences(parameters: MatcherParameters) -> bool:
    """Whether the differences of eqs 1-7 have any weight."""
    return parameters.tau_ad > 0 or parameters.alpha * parameters.tau_gm > 0


def largest_cost(parameters: MatcherParameters) -> float:
    """The most that two pixels can cost (eq 8 and the census), intensities on 0..1."""
    return parameters.tau_ad + parameters.alpha * parameters.tau_gm + parameters.census_weight


def byte_costs(
    planes: MatchingPlanes, width: int, parameters: MatcherParameters, lanes: int, largest: int
) -> ByteCosts:
    """The costs of images `width` px wide, scaled to 0 .. largest (at most 255), in vectors of `lanes`."""
    outside = np.full(planes.census.shape[3], largest, np.uint8)
    outside[planes.before:planes.before + width] = 0
    behind = np.zeros(lanes, np.uint8)
    behind[parameters.num_disparities:] = largest
    full = max(largest_cost(parameters), 1e-9)
    scale = largest * 2**_FRACTION / full
    return ByteCosts(
        planes.values, planes.census, planes.before, parameters.min_disparity, outside, behind,
        has_differences(parameters), *_term(parameters.tau_ad, scale),
        *_term(parameters.tau_gm, parameters.alpha * scale),
        np.uint16(round(parameters.census_weight * scale / census.BITS)))


def _term(tau: float, scale: float) -> tuple[np.uint16, np.uint16, np.uint16]:
    """(truncation, factor, weight): min(difference, truncation) * factor uses all 16 bits; times weight / 2^16 is the
    term in the unit of the sums."""
    most = min(round(tau * INTENSITY), INTENSITY)
    if most == 0 or scale == 0:
        return np.uint16(0), np.uint16(0), np.uint16(0)
    factor = 65535 // most
    return np.uint16(most), np.uint16(factor), np.uint16(min(round(tau * scale * 2**16 / (most * factor)), 65535))


class Terms(NamedTuple):
    """The scalars of `ByteCosts`."""

    has_differences: bool
    tau_ad: np.uint16
    widen_ad: np.uint16
    weight_ad: np.uint16
    tau_gm: np.uint16
    widen_gm: np.uint16
    weight_gm: np.uint16
    bit: np.uint16


class CostRow(NamedTuple):
    """One row of one view for `cost_at`: pointers, and where its pixel 0 and that pixel's partner lie behind them.

    No arrays: numba would count their references at each pixel.
    """

    terms: Terms

    values: Any
    others: Any
    channels: int
    plane: int
    value: int
    other_value: int
    nibbles: Any
    other_nibbles: Any
    pitch: int
    nibble: int
    other_nibble: int
    outside: Any
    partner: int
    first: int
    end: int


@kernel
def cost_row(costs: ByteCosts, view: int, y: int, width: int, first: int) -> CostRow:
    """Row y of `view`, whose images are `width` px wide, at disparities from `first` (counted from the start) on."""
    values, others = costs.values[view], costs.values[1 - view]
    own, other = costs.census[view], costs.census[1 - view]
    pitch = costs.outside.size
    partner = costs.before + width - 1 + costs.start + first
    line, nibbles = y * pitch, y * _NIBBLES * pitch
    terms = Terms(costs.has_differences, costs.tau_ad, costs.widen_ad, costs.weight_ad, costs.tau_gm, costs.widen_gm,
                  costs.weight_gm, costs.bit)
    return CostRow(terms, pointer(values), pointer(others), values.shape[0] - 1, values.shape[1] * pitch,
                   line + costs.before, line + partner, pointer(own), pointer(other), pitch, nibbles + costs.before,
                   nibbles + partner, pointer(costs.outside), partner, costs.before, costs.before + width)


@kernel(inline=True)
def cost_at(row: CostRow, x: int, behind: Any, lanes: Lanes) -> Any:
    """Costs of pixel x of a row, uint8, a vector over the disparities; behind: pointer to those of this vector."""
    if row.terms.has_differences:
        cost = _all_terms(row, x, lanes)
    elif row.terms.bit == np.uint16(2**_FRACTION):
        cost = _distance(row, x, lanes)
    else:
        cost = _rounded(widen(_distance(row, x, lanes)) * splat_wide(row.terms.bit, lanes), lanes)
    start = row.partner - x
    if start < row.first or start + UNIT * len(lanes) > row.end:
        cost = maximum_wide(cost, load_wide(row.outside, start, lanes))
    return maximum_wide(cost, load_wide(behind, 0, lanes))


@kernel(inline=True)
def _distance(row: CostRow, x: int, lanes: Lanes) -> Any:
    """Bits of the census that differ."""
    own, there = row.nibble + x, row.other_nibble - x
    distance = differing_bits(row.nibbles[own], load_wide(row.other_nibbles, there, lanes))
    for k in range(1, _NIBBLES):
        step = k * row.pitch
        distance = distance + differing_bits(row.nibbles[own + step], load_wide(row.other_nibbles, there + step, lanes))
    return distance


@kernel(inline=True)
def _rounded(total: Any, lanes: Lanes) -> Any:
    return narrow_wide(shift_right(total + splat_wide(np.uint16(2**(_FRACTION - 1)), lanes), _FRACTION))


@kernel
def _all_terms(row: CostRow, x: int, lanes: Lanes) -> Any:
    """The sum of all three terms (eq 8 and the census)."""
    own, there = row.value + x, row.other_value - x
    difference = _difference(row, own, there, lanes)
    channels = row.channels
    if channels == 3:
        third = splat_wide(np.uint16(21846), lanes)
        difference = (multiply_high(difference, third)
                      + multiply_high(_difference(row, own + row.plane, there + row.plane, lanes), third)
                      + multiply_high(_difference(row, own + 2 * row.plane, there + 2 * row.plane, lanes), third))
    slope = _difference(row, own + channels * row.plane, there + channels * row.plane, lanes)
    total = (_truncated(difference, row.terms.tau_ad, row.terms.widen_ad, row.terms.weight_ad, lanes)
             + _truncated(slope, row.terms.tau_gm, row.terms.widen_gm, row.terms.weight_gm, lanes))
    if row.terms.bit > 0:
        total = total + widen(_distance(row, x, lanes)) * splat_wide(row.terms.bit, lanes)
    return _rounded(total, lanes)


@kernel
def _difference(row: CostRow, own: int, there: int, lanes: Lanes) -> Any:
    return absolute_difference(splat_wide(row.values[own], lanes), load_wide(row.others, there, lanes))


@kernel
def _truncated(difference: Any, tau: np.uint16, factor: np.uint16, weight: np.uint16, lanes: Lanes) -> Any:
    cut = minimum_wide(difference, splat_wide(tau, lanes))
    return multiply_high(cut * splat_wide(factor, lanes), splat_wide(weight, lanes))
