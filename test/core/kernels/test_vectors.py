"""Every function of `vectors`, lane by lane against numpy."""
from pathlib import Path

import numba
import numpy as np
import pytest

from svdm_core.kernels import vectors

LANES = {np.float32: 16, np.int16: 16, np.int32: 16, np.uint64: 16, np.uint16: 32}
INTEGERS = [kind for kind in LANES if kind is not np.float32]
OFFSET = 3  # vectors need not begin where an array does


def values(kind, seed=0, lanes=None):
    """A vector's worth of values over the whole range, its ends among them."""
    rng = np.random.default_rng(seed)
    lanes = lanes or LANES[kind]
    if kind is np.float32:
        return np.concatenate([rng.normal(0, 1000, lanes - 2), [0.0, -0.5]]).astype(np.float32)
    limits = np.iinfo(kind)
    inner = rng.integers(limits.min, limits.max, lanes - 2, kind, endpoint=True)
    return rng.permutation(np.concatenate([inner, np.array([limits.min, limits.max], kind)]))


def stored(function, *arrays, kind=None):
    """What `function` gives for the vectors in `arrays`, as an array; lanes behind it must stay as they were."""
    kernel = numba.njit(function)
    kind = kind or arrays[0].dtype
    result = np.full(OFFSET + 40, 7, kind)
    padded = [np.concatenate([np.zeros(OFFSET, array.dtype), array, np.zeros(1, array.dtype)]) for array in arrays]
    kernel(result, *padded)
    lanes = arrays[0].size
    assert (result[:OFFSET] == 7).all() and (result[OFFSET + lanes:] == 7).all()
    return result[OFFSET:OFFSET + lanes]


def unary(operation):
    def function(to, a):
        vectors.store(vectors.pointer(to), OFFSET, operation(vectors.load(vectors.pointer(a), OFFSET)))
    return function


def binary(operation):
    def function(to, a, b):
        vectors.store(vectors.pointer(to), OFFSET, operation(vectors.load(vectors.pointer(a), OFFSET),
                                                             vectors.load(vectors.pointer(b), OFFSET)))
    return function


def reduced(operation, array, *more):
    """What `operation` makes of one vector, for functions that give numbers."""
    @numba.njit
    def kernel(a, more):
        return operation(vectors.load(vectors.pointer(a), 0), *more)

    return kernel(array, more)


@numba.njit
def identity(a):
    return a


@numba.njit
def plus(a, b):
    return a + b


@numba.njit
def minus(a, b):
    return a - b


@numba.njit
def times(a, b):
    return a * b


@numba.njit
def exclusive_or(a, b):
    return a ^ b


@numba.njit
def bitwise_or(a, b):
    return a | b


@pytest.mark.parametrize('kind', LANES)
def test_a_vector_is_loaded_and_stored_from_any_index(kind):
    np.testing.assert_array_equal(stored(unary(identity), values(kind)), values(kind))


@pytest.mark.parametrize('kind', LANES)
@pytest.mark.parametrize(('operation', 'expected'), [(plus, np.add), (minus, np.subtract), (times, np.multiply)])
def test_arithmetic_is_that_of_numpy_and_wraps_around(kind, operation, expected):
    a, b = values(kind, 1), values(kind, 2)
    with np.errstate(over='ignore'):
        np.testing.assert_array_equal(stored(binary(operation), a, b), expected(a, b))


@pytest.mark.parametrize('kind', INTEGERS)
@pytest.mark.parametrize(('operation', 'expected'), [(exclusive_or, np.bitwise_xor), (bitwise_or, np.bitwise_or)])
def test_bits_are_those_of_numpy(kind, operation, expected):
    a, b = values(kind, 1), values(kind, 2)
    np.testing.assert_array_equal(stored(binary(operation), a, b), expected(a, b))


@pytest.mark.parametrize('kind', LANES)
def test_minimum_takes_the_sign_into_account(kind):
    a, b = values(kind, 1), values(kind, 2)

    @numba.njit
    def smaller(a, b):
        return vectors.minimum(a, b)

    np.testing.assert_array_equal(stored(binary(smaller), a, b), np.minimum(a, b))


@pytest.mark.parametrize('kind', LANES)
def test_splat_repeats_a_number(kind):
    def function(to, a):
        vectors.store(vectors.pointer(to), OFFSET, vectors.splat(a[OFFSET + 4]))

    a = values(kind)
    np.testing.assert_array_equal(stored(function, a), np.full(a.size, a[4]))


def test_absolute_takes_the_sign_away():
    @numba.njit
    def without_sign(a):
        return vectors.absolute(a)

    a = values(np.float32)
    np.testing.assert_array_equal(stored(unary(without_sign), a), np.abs(a))


def test_ones_are_counted():
    @numba.njit
    def ones(a):
        return vectors.count_ones(a)

    a = values(np.uint64)
    np.testing.assert_array_equal(stored(unary(ones), a), np.bitwise_count(a))


@pytest.mark.parametrize('kind', INTEGERS)
def test_integers_become_the_nearest_floats(kind):
    @numba.njit
    def as_float(a):
        return vectors.to_float(a)

    a = values(kind) if kind is not np.uint64 else values(np.int32).astype(np.int64).clip(0).astype(np.uint64)
    np.testing.assert_array_equal(stored(unary(as_float), a, kind=np.float32), a.astype(np.float32))


@pytest.mark.parametrize('kind', [np.int16, np.int32, np.uint64])
def test_a_value_is_chosen_where_two_integers_are_equal(kind):
    @numba.njit
    def function(to, a, b, then, otherwise):
        vectors.store(vectors.pointer(to), OFFSET, vectors.where_equal(
            vectors.load(vectors.pointer(a), OFFSET), vectors.load(vectors.pointer(b), OFFSET),
            vectors.load(vectors.pointer(then), OFFSET), vectors.load(vectors.pointer(otherwise), OFFSET)))

    a, b = values(kind, 1), values(kind, 1)
    b[::3] ^= kind(1)
    then, otherwise = values(np.float32, 3), values(np.float32, 4)
    result = stored(function.py_func, a, b, then, otherwise, kind=np.float32)
    np.testing.assert_array_equal(result, np.where(a == b, then, otherwise))


def test_the_smallest_float_and_its_first_lane():
    @numba.njit
    def smallest(a):
        return vectors.smallest(a)

    a = np.abs(values(np.float32)) + np.float32(1)
    for lane in range(a.size):
        a[lane:] = np.abs(values(np.float32, lane))[lane:] + np.float32(1)
        a[lane] = 0.25
        if lane < a.size - 1:
            a[-1] = 0.25  # the first of equals counts
        bits, found = reduced(smallest, a)
        assert (np.int32(bits).view(np.float32), found) == (0.25, lane)
        a[lane] = 2.0


def test_the_sum_of_the_lanes():
    @numba.njit
    def total(a):
        return vectors.lane_sum(a)

    whole = np.arange(16, dtype=np.float32) * 1000  # exact in any order
    assert reduced(total, whole) == whole.sum()
    a = values(np.float32)
    assert reduced(total, a) == pytest.approx(float(a.astype(np.float64).sum()), abs=1e-6 * float(np.abs(a).sum()))


def test_every_function_is_tested_here():
    text = Path(__file__).read_text()
    public = {name for name, value in vars(vectors).items()
              if type(value).__name__ == '_Intrinsic' and not name.startswith('_')}
    assert len(public) >= 11 and {name for name in public if f'vectors.{name}(' not in text} == set()
