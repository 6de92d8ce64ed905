"""Against naive oracles, pixel by pixel."""
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svdm_core.evaluation.trust_curves import (
    BINS,
    COVERAGES,
    area,
    auc,
    calibration_error,
    kept_and_wrong,
    pooled,
    reliability,
    tally_of,
    wrong_at,
)

PIXELS = st.lists(st.tuples(st.integers(0, 6), st.booleans()), min_size=1, max_size=12)
"""Sixths of a confidence, so that many are equal; and wrong or not."""


def arrays(pixels):
    sixths, wrong = zip(*pixels, strict=True)
    return np.array(sixths, np.float32) / 6, np.array(wrong)


def tally(pixels):
    return tally_of(*arrays(pixels))


def naive_wrong_at(pixels, coverage):
    """Mean over the orders that equal confidences can come in: each pixel then stands for the mean of its equals."""
    equals = {level: [wrong for other, wrong in pixels if other == level] for level, _ in pixels}
    ranked = [sum(equals[level]) / len(equals[level]) for level, _ in sorted(pixels, reverse=True)]
    wanted = coverage / 100 * len(ranked)
    taken = sum(ranked[:int(wanted)])
    if int(wanted) < len(ranked):
        taken += (wanted - int(wanted)) * ranked[int(wanted)]
    return 100 * taken / wanted


@given(PIXELS, st.floats(0.5, 100))
def test_what_is_wrong_of_what_is_kept(pixels, coverage):
    assert wrong_at(tally(pixels), coverage) == pytest.approx(naive_wrong_at(pixels, coverage), abs=1e-6)


@given(PIXELS)
def test_the_area_is_the_mean_of_the_curve(pixels):
    expected = sum(naive_wrong_at(pixels, coverage) for coverage in range(1, 101)) / 100
    assert area(tally(pixels)) == pytest.approx(expected, abs=1e-6) and COVERAGES[0] == 1 and COVERAGES[-1] == 100


@given(PIXELS)
def test_the_auc_counts_pairs(pixels):
    right, wrong = ([level for level, is_wrong in pixels if is_wrong == which] for which in (False, True))
    pairs = [(a > b) + (a == b) / 2 for a, b in itertools.product(right, wrong)]
    found = auc(tally(pixels))
    assert math.isnan(found) if not pairs else found == pytest.approx(sum(pairs) / len(pairs))


def test_one_confidence_for_all_tells_nothing_and_the_truth_tells_all():
    wrong = np.array([True, False, False, False])
    nothing, everything = tally_of(np.full(4, 0.5), wrong), tally_of(1.0 - wrong, wrong)
    assert auc(nothing) == 0.5 and wrong_at(nothing, [10, 50, 100]).tolist() == [25, 25, 25]
    assert auc(everything) == 1 and wrong_at(everything, [10, 75, 100]).tolist() == [0, 0, 25]


@given(PIXELS, PIXELS, st.integers(1, 4))
def test_each_scene_counts_alike_however_many_pixels_it_has(first, second, times):
    once, often = pooled([tally(first), tally(second)]), pooled([tally(first * times), tally(second)])
    for a, b in zip(once, often, strict=True):
        np.testing.assert_allclose(a, b, atol=1e-12)
    both = (wrong_at(tally(first), 100) + wrong_at(tally(second), 100)) / 2
    assert wrong_at(once, 100) == pytest.approx(both) and (np.diff(once.levels) < 0).all()


def _chance(confidence):
    return 0.9 - 0.8 * confidence


@given(PIXELS)
def test_the_reliability_is_that_of_the_pixels_of_each_bin(pixels):
    bins = {}
    for level, wrong in zip(*arrays(pixels), strict=True):
        bins.setdefault(min(int(BINS * _chance(float(level))), BINS - 1), []).append((_chance(float(level)), wrong))
    found = reliability([(tally(pixels), _chance)])
    expected = [(len(some) / len(pixels), *np.mean(some, axis=0)) for _, some in sorted(bins.items())]
    np.testing.assert_allclose(np.transpose(found), expected, atol=1e-9)
    error = sum(share * abs(predicted - observed) for share, predicted, observed in expected)
    assert calibration_error(found) == pytest.approx(error, abs=1e-9)


def test_the_reliability_of_two_scenes_is_predicted_by_each_ones_own():
    surely_right, surely_wrong = (tally_of(np.ones(size), np.full(size, wrong)) for size, wrong in ((2, 0), (6, 1)))
    found = reliability([(surely_right, np.zeros_like), (surely_wrong, np.ones_like)])
    assert found.share.tolist() == [0.5, 0.5] and calibration_error(found) == 0
    assert calibration_error(reliability([(surely_right, np.ones_like), (surely_wrong, np.zeros_like)])) == 1


def test_kept_and_wrong_by_hand():
    wrong = np.array([True, False, True, False])
    assert kept_and_wrong(np.array([True, True, True, False]), wrong) == pytest.approx((75, 200 / 3))
    assert kept_and_wrong(np.zeros(4, bool), wrong) == (0, 0)


def test_no_pixel_is_told():
    with pytest.raises(ValueError, match='there is no pixel to judge'):
        tally_of(np.zeros(0), np.zeros(0, bool))
