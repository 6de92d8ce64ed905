"""Fits of made points: outliers, too few, in a part of the image, and fields that are not significant."""
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svdm_core import RowAlignment
from svdm_core.row_alignment.alignment import RowPoints
from svdm_core.row_alignment.fitting import fit_rows, is_better

SHAPE = (300, 400)
FIELD = RowAlignment((0.3, -0.4, 0.5, 0.6, -0.2, 0.1), 400, 300)


def points_of(field, number=400, seed=0, error=0.1, part=(1.0, 1.0)):
    """Random places in a part of the image, and the field there with errors, px."""
    random = np.random.default_rng(seed)
    x, y = random.uniform(0, 400 * part[0], number), random.uniform(0, 300 * part[1], number)
    return RowPoints(x, y, field.offsets(x, y) + random.normal(0, error, number))


def largest_difference(one, another):
    x, y = np.meshgrid(np.linspace(0, 399, 9), np.linspace(0, 299, 9))
    return np.abs(one.offsets(x, y) - another.offsets(x, y)).max()


def test_a_field_is_found_with_its_residuals():
    points = points_of(FIELD)
    rows = fit_rows(points, SHAPE)
    assert largest_difference(rows, FIELD) < 0.1 and (rows.width, rows.height, rows.points) == (400, 300, 400)
    assert rows.residual_after == pytest.approx(0.1, rel=0.15)
    assert rows.residual_before == pytest.approx(np.sqrt(np.mean(points.dy**2)), rel=0.05)


def test_points_of_several_pairs_are_pooled():
    parts = [points_of(FIELD, 200, seed) for seed in range(3)]
    whole = RowPoints(*(np.concatenate(values) for values in zip(*parts, strict=True)))
    assert fit_rows(parts, SHAPE) == fit_rows(whole, SHAPE)
    assert fit_rows([], SHAPE) is None


def test_a_third_of_wrong_points_does_not_matter_and_chance_is_no_field():
    wrong, chance = np.random.default_rng(1).uniform(-2, 2, 2000), np.random.default_rng(2).uniform(0, 1, 2000)
    points = points_of(FIELD, 2000)
    third, most = (points._replace(dy=np.where(chance < share, wrong, points.dy)) for share in (0.33, 0.6))
    assert largest_difference(fit_rows(third, SHAPE), FIELD) < 0.15
    assert fit_rows(most, SHAPE) is None
    assert fit_rows(points._replace(dy=wrong), SHAPE) is None


def test_what_makes_no_difference_is_no_field_however_many_points_say_so():
    small, large = (RowAlignment((constant, 0, 0, 0, 0, 0), 400, 300) for constant in (0.03, 0.15))
    assert fit_rows(points_of(small, 20000), SHAPE) is None
    assert largest_difference(fit_rows(points_of(large, 20000), SHAPE), large) < 0.02


def test_fewer_than_60_points_are_no_field():
    points = points_of(FIELD, 60, error=0.02)
    assert fit_rows(points, SHAPE) is not None
    assert fit_rows(RowPoints(*(values[:59] for values in points)), SHAPE) is None


def test_points_in_a_part_of_the_image_are_no_field_and_badly_spread_ones_have_no_squares():
    for part in ((0.5, 1), (1, 0.5), (0.4, 0.4)):
        assert fit_rows(points_of(FIELD, part=part), SHAPE) is None
    plain = RowAlignment((0.3, -0.4, 0.5, 0.6, 0, 0), 400, 300)
    rows = fit_rows(points_of(plain, 100, error=0.25), SHAPE)
    assert rows.coefficients[4:] == (0, 0) and largest_difference(rows, plain) < 0.25
    assert fit_rows(points_of(plain, 700, error=0.2), SHAPE).coefficients[4] != 0


def test_a_field_that_goes_beyond_what_is_believed_anywhere_is_none():
    steep = RowAlignment((0, 0, 0, 3.9, 0, 0), 400, 300)
    assert largest_difference(fit_rows(points_of(steep), SHAPE), steep) < 0.15
    assert fit_rows(points_of(RowAlignment((0, 0, 0, 4.2, 0, 0), 400, 300)), SHAPE) is None


@given(st.integers(0, 10**6), st.sampled_from([0.0, 0.02, 0.1, 0.5]), st.integers(60, 400))
def test_aligned_rows_are_never_corrected(seed, error, number):
    assert fit_rows(points_of(RowAlignment.identity(400, 300), number, seed, error), SHAPE) is None


@given(st.lists(st.tuples(st.floats(0, 400), st.floats(0, 300), st.floats(-2, 2)), max_size=120))
def test_any_points_give_finite_coefficients_or_nothing(places):
    points = RowPoints(*np.array(places, float).reshape(-1, 3).T)
    rows = fit_rows(points, SHAPE)
    assert rows is None or np.isfinite(rows.coefficients).all()


def test_the_first_guess_changes_next_to_nothing():
    points = points_of(FIELD)
    assert largest_difference(fit_rows(points, SHAPE, FIELD), fit_rows(points, SHAPE)) < 0.02


def test_one_field_is_better_than_another_only_significantly():
    points = points_of(FIELD)
    near = RowAlignment((0.31, *FIELD.coefficients[1:]), 400, 300)
    far = RowAlignment((0.5, *FIELD.coefficients[1:]), 400, 300)
    assert is_better(points, FIELD, far) and not is_better(points, far, FIELD)
    assert not is_better(points, FIELD, near) and not is_better(points, FIELD, FIELD)
