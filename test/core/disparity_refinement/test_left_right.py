import numpy as np
import oracles
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import labels
from svdm_core.disparity_refinement.left_right import left_right_check

SHAPES = st.tuples(st.integers(1, 6), st.integers(1, 12))


@settings(max_examples=60, deadline=None, derandomize=True)
@given(SHAPES, st.integers(0, 4), st.sampled_from([0.0, 0.5, 1.0, 2.5]), st.integers(0, 2**32 - 1))
def test_left_right_check_is_equation_15(shape, min_disparity, tau_lr, seed):
    left, right = labels(shape, seed, 4), labels(shape, seed + 1, 4)
    np.testing.assert_array_equal(left_right_check(left, right[:, ::-1], min_disparity, tau_lr),
                                  oracles.left_right_check(left, right, min_disparity, tau_lr))
