import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import labels

from svdm_core.disparity_refinement.checking import fill_along_scanlines

SHAPES = st.tuples(st.integers(1, 6), st.integers(1, 12))


@settings(max_examples=80, deadline=None, derandomize=True)
@given(SHAPES, st.floats(0, 1), st.integers(0, 2**32 - 1))
def test_filling_is_equation_16(shape, share, seed):
    disparity, valid = labels(shape, seed).astype(np.int16), np.random.default_rng(seed).random(shape) < share
    before = disparity.copy()
    np.testing.assert_array_equal(fill_along_scanlines(disparity, valid), oracles.fill(disparity, valid))
    np.testing.assert_array_equal(disparity, before)


def test_filling_takes_the_background_and_leaves_a_row_without_it():
    disparity = np.array([[9, 0, 0, 3, 0], [-1, -2, -3, -4, -5]], np.int16)
    assert fill_along_scanlines(disparity, disparity > 0).tolist() == [[9, 3, 3, 3, 3], [-1, -2, -3, -4, -5]]
    reversed_map = fill_along_scanlines(disparity[:, ::-1], disparity[:, ::-1] > 0)  # any strides
    assert reversed_map[0].tolist() == [3, 3, 3, 3, 9]


def test_a_wrong_map_is_refused():
    disparity = np.zeros((2, 3), np.int16)
    for wrong, valid in ((disparity.astype(np.int32), disparity == 0), (disparity, disparity[:1] == 0)):
        with pytest.raises(ValueError, match='must have the same shape, and disparity must be int16'):
            fill_along_scanlines(wrong, valid)
    with pytest.raises(ValueError, match='a valid value below 0 is not allowed'):
        fill_along_scanlines(disparity - 1, disparity == 0)
