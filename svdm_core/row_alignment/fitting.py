"""From measured offsets to a field over the image: a robust fit, and what it must stand before it is believed."""
from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ..kernels.arrays import Bool, Float64
from .alignment import TERMS, RowAlignment, RowPoints, terms

FEWEST_POINTS = 60
LARGEST_OFFSET = 4.0
"""px; no field goes beyond, anywhere in the image."""
_ROUNDS, _WIDE_ROUNDS, _WIDER = 15, 4, 3.0
"""Rounds of weights; the first of them have a bound so many times wider."""
_SPREADS, _NARROWEST = 3.0, 0.25
"""A point counts for less the farther it is off the field, and for nothing beyond the larger of so many standard
deviations and so many px."""
_RIDGE = 0.001
"""Draws all coefficients but the constant to 0, as a share of the weights."""
_TERM_COUNTS = (6, 4)
"""Of TERMS, from the first on: all, or without squares. A plane or a constant alone are none: what real rigs have is
mostly uv, of which points in a part of the image make a plane that is wrong everywhere else."""
_LARGEST_ERROR = 0.15
"""px, standard error of the field anywhere in the image, at most; else it has fewer terms."""
_CELLS = 8
"""Columns and rows of cells: what is fitted on the black ones of a chessboard is judged on the white ones."""
_QUARTERS, _IN_A_QUARTER = 3, 10
"""Least number of quarters of the image that have so many points each."""
_CAP = 1.0
"""px; an offset counts as much as this at most, so that wrong points do not decide."""
_SIGNIFICANT = 4.0
"""Standard errors by which the field makes the offsets smaller, at least."""
_SMALLER = 0.9
"""Share of the mean offset that may be left."""
_WITHIN, _SHARE_WITHIN = 0.5, 0.6
"""px; share of the points that must be so near to the field. Real pairs have nine in ten, chance has a quarter."""


class _Fit(NamedTuple):
    """basis: TERMS (N, 6) of the points; first: coefficients (6) that it began with; number: how many were fitted;
    coefficients (6); weights of the points (N), 0..1; error: px, largest standard error of the field."""

    basis: Float64
    first: Float64
    number: int
    coefficients: Float64
    weights: Float64
    error: float


def pooled(points: RowPoints | Sequence[RowPoints]) -> RowPoints:
    """All points as one."""
    if isinstance(points, RowPoints):
        return points
    return RowPoints(*(np.concatenate([np.zeros(0), *column]) for column in zip(*points, strict=True))) if points \
        else RowPoints(*np.zeros((3, 0)))


def fit_rows(
    points: RowPoints | Sequence[RowPoints], shape: tuple[int, ...], start: RowAlignment | None = None,
) -> RowAlignment | None:
    """The field that measured offsets follow; None where there are fewer than 60 points, where they are in a part of
    the image only, or where the field would not make them significantly smaller.

    points: of one pair or of several by the same cameras; shape: of the images, (height, width, ...). start: a field
    that is nearly right, the fit's first guess. A field has as many of the terms as the points can tell.
    """
    known = pooled(points)
    fit = _fit(known, shape, start)
    if fit is None or not _stands(known, fit, shape):
        return None
    return _alignment(known, fit, shape)


def guess_rows(points: RowPoints, shape: tuple[int, ...], start: RowAlignment | None) -> RowAlignment | None:
    """The same without a test whether it is significant: a field from which to measure again."""
    fit = _fit(points, shape, start)
    return None if fit is None else _alignment(points, fit, shape)


def _fit(points: RowPoints, shape: tuple[int, ...], start: RowAlignment | None) -> _Fit | None:
    if not can_tell(points, shape):
        return None
    basis = terms(points.x_right, points.y, shape)
    first = np.zeros(len(TERMS)) if start is None else np.array(start.coefficients)
    return _best_fit(basis, points.dy, first, shape)


def _alignment(points: RowPoints, fit: _Fit, shape: tuple[int, ...]) -> RowAlignment:
    kept = fit.weights > 0
    before, after = points.dy[kept], (points.dy - fit.basis @ fit.coefficients)[kept]
    first, second, third, fourth, fifth, sixth = map(float, fit.coefficients)
    return RowAlignment((first, second, third, fourth, fifth, sixth), shape[1], shape[0], points.size,
                        _rms(before), _rms(after))


def _best_fit(basis: Float64, dy: Float64, first: Float64, shape: tuple[int, ...]) -> _Fit | None:
    """With as many terms as the points can tell; None where they are too few, or too near to each other."""
    for count in _TERM_COUNTS:
        fit = robust_fit(basis, dy, first, count, shape)
        if fit.error <= _LARGEST_ERROR:
            inside = np.abs(_grid(shape) @ fit.coefficients).max() <= LARGEST_OFFSET
            return fit if inside else None
    return None


def robust_fit(basis: Float64, dy: Float64, first: Float64, count: int, shape: tuple[int, ...]) -> _Fit:
    """Rounds of weighted least squares for the first `count` coefficients, the others 0; weights are Tukey's.

    The ridge draws them to those of `first`.
    """
    start = np.where(np.arange(len(TERMS)) < count, first, 0.0)
    own, wanted = basis[:, :count], dy - basis @ start
    change = np.zeros(count)
    change[0] = np.median(wanted)
    for number in range(_ROUNDS):
        off = wanted - own @ change
        spread = 1.4826 * float(np.median(np.abs(off)))
        bound = max(_SPREADS * spread, _NARROWEST) * (_WIDER if number < _WIDE_ROUNDS else 1.0)
        weights = np.clip(1 - (off / bound)**2, 0, None)**2
        normal = (own * weights[:, None]).T @ own
        ridge = np.full(count, _RIDGE * weights.sum() + 1e-12)
        ridge[0] = 1e-12
        change = np.linalg.solve(normal + np.diag(ridge), (own * weights[:, None]).T @ wanted)
    start[:count] += change
    return _Fit(basis, first, count, start, weights, _error(own, weights, max(spread, 0.02), _grid(shape)[:, :count]))


def _error(own: Float64, weights: Float64, spread: float, grid: Float64) -> float:
    """Largest standard error of the field at `grid`, px: what independent errors of the points make of it."""
    normal = (own * weights[:, None]).T @ own + 1e-9 * np.eye(own.shape[1])
    variance = np.einsum('ij,ij->i', grid, np.linalg.solve(normal, grid.T).T)
    return spread * float(np.sqrt(np.maximum(variance, 0).max()))


def _grid(shape: tuple[int, ...]) -> Float64:
    """Terms at 5 x 5 places from corner to corner."""
    x, y = np.meshgrid(np.linspace(0, shape[1] - 1, 5), np.linspace(0, shape[0] - 1, 5))
    return terms(x.ravel(), y.ravel(), shape)


def can_tell(points: RowPoints, shape: tuple[int, ...]) -> bool:
    """Whether there are enough points, and not all in a part of the image."""
    if points.size < FEWEST_POINTS:
        return False
    quarter = 2 * (points.y >= shape[0] / 2) + (points.x_right >= shape[1] / 2)
    return int((np.bincount(quarter.astype(np.intp), minlength=4) >= _IN_A_QUARTER).sum()) >= _QUARTERS


def _stands(points: RowPoints, fit: _Fit, shape: tuple[int, ...]) -> bool:
    """Whether the field makes offsets smaller at places that it was not fitted on, and most points are near to it."""
    basis = fit.basis
    near = np.abs(points.dy - basis @ fit.coefficients) <= _WITHIN
    if near.mean() < _SHARE_WITHIN:
        return False
    before, after = np.minimum(np.abs(points.dy), _CAP), np.zeros(points.size)
    black = _is_black(points, shape)
    for judged in (black, ~black):
        if min(judged.sum(), (~judged).sum()) < FEWEST_POINTS // 4:
            return False
        half = robust_fit(basis[~judged], points.dy[~judged], fit.first, fit.number, shape)
        after[judged] = np.minimum(np.abs(points.dy - basis @ half.coefficients)[judged], _CAP)
    return bool(after.mean() <= _SMALLER * before.mean()) and _is_significant(before - after)


def is_better(points: RowPoints, rows: RowAlignment, than: RowAlignment) -> bool:
    """Whether points are significantly nearer to the one field than to the other."""
    near, far = (np.minimum(np.abs(points.dy - field.offsets(points.x_right, points.y)), _CAP)
                 for field in (rows, than))
    return _is_significant(far - near)


def _is_significant(gain: Float64) -> bool:
    """Whether the mean of what each point gains is above chance."""
    return bool(gain.mean() > _SIGNIFICANT * gain.std() / np.sqrt(gain.size))


def _is_black(points: RowPoints, shape: tuple[int, ...]) -> Bool:
    """Whether points are on the black cells of a chessboard over the image."""
    column, row = (np.floor(place * _CELLS / size) for place, size in ((points.x_right, shape[1]),
                                                                      (points.y, shape[0])))
    return np.asarray((column + row) % 2 == 0)


def _rms(values: Float64) -> float:
    return float(np.sqrt(np.mean(values**2))) if values.size else 0.0
