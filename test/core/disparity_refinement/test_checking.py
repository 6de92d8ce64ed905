import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import labels
from stages import run, task_phase

from svdm_core.disparity_refinement.checking import Checked, check_and_fill
from svdm_core.kernels.stripes import block_count

UNMEASURED = np.zeros((0, 0), np.uint8)


def checked(left, right, every, min_disparity, tau_lr, margin=UNMEASURED, least=9):
    """(valid, filled); right: mirrored."""
    valid, filled = np.ones(left.shape, np.bool_), np.full(left.shape, 99, np.int16)
    runs = np.full((len(left), left.shape[1] + 2), -9, np.int32)
    before = left.copy(), right.copy()
    run(task_phase(block_count(len(left)), check_and_fill,
                   Checked(left, right, every, min_disparity, np.float32(tau_lr), margin, np.uint8(least), valid,
                           filled, runs)))
    for row, told in zip(valid, runs, strict=True):
        assert told[1:1 + 2 * told[0]].reshape(-1, 2).tolist() == oracles.runs(~row)
    np.testing.assert_array_equal(left, before[0])
    np.testing.assert_array_equal(right, before[1])
    return valid, filled


@settings(max_examples=100, deadline=None, derandomize=True)
@given(st.tuples(st.integers(1, 35), st.integers(1, 12)), st.sampled_from([1, 2, 3]), st.integers(-9, 9),
       st.sampled_from([0.0, 0.5, 1.0, 2.5]), st.sampled_from([1, 4, 9]), st.integers(0, 2**32 - 2))
def test_the_check_is_equation_15_and_filling_equation_16(shape, every, min_disparity, tau_lr, end, seed):
    height, width = shape
    rows = len(range(every // 2, height, every)) or height
    left, right = (labels(part, seed + k, end).astype(np.int16) for k, part in enumerate((shape, (rows, width))))
    valid, filled = checked(left, right, every, min_disparity, tau_lr)
    beside = right[np.minimum(np.arange(height) // every, rows - 1), ::-1]
    expected = oracles.left_right_check(left, beside, min_disparity, tau_lr)
    np.testing.assert_array_equal(valid, expected)
    np.testing.assert_array_equal(filled, oracles.fill(left, expected))


def test_filling_takes_the_background():
    left = np.array([[9, 0, 0, 3, 8, 8, 5]], np.int16)
    right = np.full((1, 7), 1, np.int16)
    assert checked(left, right, 1, 0, 0.0)[1].tolist() == left.tolist()  # none is valid
    right[0, 6] = 3  # column 0, which x = 3 meets
    assert checked(left, right, 1, 0, 0.0)[1].tolist() == [[3] * 7]
    right[0, 5] = 5  # column 1, which x = 6 meets
    assert checked(left, right, 1, 0, 0.0)[1].tolist() == [[3, 3, 3, 3, 3, 3, 5]]


@pytest.mark.parametrize('least', [0, 1, 26, 255])
def test_a_valid_disparity_is_unique_by_the_margin_that_is_asked_for(least):
    left = labels((5, 40), 1, 4).astype(np.int16)
    right = labels((5, 40), 2, 4).astype(np.int16)
    margin = np.random.default_rng(3).choice(np.array([0, 1, 25, 26, 27, 254, 255], np.uint8), (5, 40))
    agreeing = checked(left, right, 1, 0, 1.0)[0]
    valid, filled = checked(left, right, 1, 0, 1.0, margin, least)
    np.testing.assert_array_equal(valid, agreeing & (margin >= least))
    np.testing.assert_array_equal(filled, oracles.fill(left, valid))
