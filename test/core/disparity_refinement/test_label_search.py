import numba
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from svdm_core.disparity_refinement.label_search import begun, narrowed


@numba.njit
def found(weights, guess):
    """The median, and how many labels were looked at."""
    total, looks, search = weights.sum(), 0, begun(guess, weights.size - 1)
    while search.low < search.high:
        looks += 1
        search = narrowed(search, 2 * weights[:search.probe + 1].sum() >= total)
    return search.low, looks


@given(st.lists(st.integers(0, 9), min_size=1, max_size=300).filter(any), st.data())
def test_it_is_the_first_label_with_half_of_the_weight_from_any_guess(weights, data):
    values = np.array(weights, np.int64)
    guess = data.draw(st.integers(0, values.size - 1))
    median, looks = found(values, guess)
    assert median == int(np.argmax(2 * np.cumsum(values) >= values.sum()))
    assert looks <= 5 + 2 * values.size.bit_length()


def test_a_guess_that_is_right_is_confirmed_by_two_looks():
    weights = np.zeros(200, np.int64)
    weights[70] = 5
    assert found(weights, 70) == (70, 2)
