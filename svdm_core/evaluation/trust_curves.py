"""How well a confidence tells right disparities from wrong ones: precision-coverage curve, AUC, reliability.

Everything is computed from a `Tally`, which holds the pixels by confidence and takes little memory. Pixels of equal
confidence are not told apart: they are taken together, as if in random order.
"""
from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ..kernels.arrays import Bool

type Numbers = NDArray[np.float64]

COVERAGES = tuple(range(1, 101))
"""%, where the curve is drawn; its area is its mean over these."""

BINS = 10
"""Of the reliability, of equal width in the predicted chance."""


class Tally(NamedTuple):
    """Pixels by confidence. levels: float64 (K,), the confidences there are, falling; pixels: float64 (K,), how many
    have it; wrong: float64 (K,), how many of these are wrong."""

    levels: Numbers
    pixels: Numbers
    wrong: Numbers


class Reliability(NamedTuple):
    """Bins of the predicted chance that hold a pixel, each float64 (B,): share of all pixels, mean predicted chance of
    being wrong, observed share of wrong ones, 0 .. 1."""

    share: Numbers
    predicted: Numbers
    observed: Numbers


def tally_of(confidence: NDArray[np.floating], wrong: Bool) -> Tally:
    """confidence: (N,). wrong: bool (N,). Raises ValueError where there is no pixel."""
    if confidence.size == 0:
        raise ValueError('there is no pixel to judge')
    return _merged(np.asarray(confidence, np.float64), np.ones(confidence.size), wrong.astype(np.float64))


def pooled(tallies: Sequence[Tally]) -> Tally:
    """One tally of several scenes, in which each scene counts alike, whatever the number of its pixels."""
    levels, pixels, wrong = (np.concatenate(parts) for parts in zip(*map(_shares, tallies), strict=True))
    return _merged(levels, pixels, wrong)


def wrong_at(tally: Tally, coverages: ArrayLike) -> Numbers:
    """% of wrong pixels among those kept. coverages: % of pixels kept, above 0, by falling confidence."""
    taken, wrong = (np.concatenate(([0.0], np.cumsum(counts))) for counts in (tally.pixels, tally.wrong))
    wanted = np.asarray(coverages, np.float64) / 100 * taken[-1]
    return np.asarray(100 * np.interp(wanted, taken, wrong) / wanted)


def area(tally: Tally) -> float:
    """Mean of the curve `wrong_at` over COVERAGES, %; the smaller the better."""
    return float(wrong_at(tally, COVERAGES).mean())


def auc(tally: Tally) -> float:
    """Area under the ROC curve: the chance that a right pixel has a larger confidence than a wrong one, equal ones
    counting half. 0.5 tells nothing, 1 all. NaN where all are right or all are wrong."""
    right = tally.pixels - tally.wrong
    pairs = right.sum() * tally.wrong.sum()
    above = np.cumsum(right) - right / 2
    return float(tally.wrong @ above / pairs) if pairs > 0 else float('nan')


def kept_and_wrong(kept: Bool, wrong: Bool) -> tuple[float, float]:
    """kept, wrong: bool (N,). % of the pixels that are kept, and % of wrong ones among these; 0 where there is none."""
    pixels = int(np.count_nonzero(kept))
    return 100 * pixels / kept.size, 100 * int(np.count_nonzero(kept & wrong)) / pixels if pixels else 0.0


def reliability(parts: Sequence[tuple[Tally, Callable[[Numbers], Numbers]]]) -> Reliability:
    """Predicted against observed over scenes that count alike, each with what predicts it: confidences -> chances of
    being wrong, 0 .. 1."""
    sums = np.zeros((3, BINS))
    for tally, chance in parts:
        levels, pixels, wrong = _shares(tally)
        predicted = chance(levels)
        bins = np.minimum((BINS * predicted).astype(int), BINS - 1)
        for row, values in zip(sums, (pixels, pixels * predicted, wrong), strict=True):
            row += np.bincount(bins, values, BINS)
    pixels, predicted, wrong = sums[:, sums[0] > 0]
    return Reliability(pixels / pixels.sum(), predicted / pixels, wrong / pixels)


def calibration_error(found: Reliability) -> float:
    """Expected calibration error, 0 .. 1: how far prediction and observation are apart, mean over the pixels."""
    return float(found.share @ np.abs(found.predicted - found.observed))


def _shares(tally: Tally) -> Tally:
    """Its pixels as shares of all of them."""
    return Tally(tally.levels, tally.pixels / tally.pixels.sum(), tally.wrong / tally.pixels.sum())


def _merged(levels: Numbers, pixels: Numbers, wrong: Numbers) -> Tally:
    """Equal levels as one."""
    found, place = np.unique(levels, return_inverse=True)
    return Tally(found[::-1], np.bincount(place, pixels)[::-1], np.bincount(place, wrong)[::-1])
