import numpy as np
import oracles
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import labels

from svdm_core.disparity_refinement.filling import fill_along_scanlines

SHAPES = st.tuples(st.integers(1, 6), st.integers(1, 12))


@settings(max_examples=80, deadline=None, derandomize=True)
@given(SHAPES, st.floats(0, 1), st.integers(0, 2**32 - 1))
def test_filling_is_equation_16(shape, share, seed):
    disparity, valid = labels(shape, seed), np.random.default_rng(seed).random(shape) < share
    before = disparity.copy()
    np.testing.assert_array_equal(fill_along_scanlines(disparity, valid), oracles.fill(disparity, valid))
    np.testing.assert_array_equal(disparity, before)


def test_filling_takes_the_background():
    disparity = np.array([[9, 0, 0, 3, 0]], np.int32)
    assert fill_along_scanlines(disparity, disparity > 0).tolist() == [[9, 3, 3, 3, 3]]
