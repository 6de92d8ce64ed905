"""Every function of `wide`, lane by lane against numpy."""
import functools
import os
import subprocess
import sys
from pathlib import Path

import numba
import numpy as np
import pytest
from checkout import CHECKOUT

from svdm_core.kernels import instructions, wide
from svdm_core.kernels.vectors import pointer

LANES = (16, 32, 64, 96, 128, 1024)  # one piece of each size, three of 32, two and sixteen of 64
KINDS = (np.uint8, np.uint16)
OFFSET = 3  # vectors need not begin where an array does
BEHIND = 5

EXPECTED = {
    'sum': lambda a, b: a + b,
    'difference': lambda a, b: a - b,
    'product': lambda a, b: a * b,
    'or': lambda a, b: a | b,
    'and': lambda a, b: a & b,
    'add_saturated': lambda a, b: clipped(a.astype(np.int64) + b, a.dtype),
    'subtract_saturated': lambda a, b: clipped(a.astype(np.int64) - b, a.dtype),
    'minimum_wide': np.minimum,
    'maximum_wide': np.maximum,
    'average': lambda a, b: ((a.astype(np.int64) + b + 1) // 2).astype(a.dtype),
    'multiply_high': lambda a, b: (a.astype(np.int64) * b >> 8 * a.itemsize).astype(a.dtype),
    'shift_right': lambda a, b: a >> 3,
    'lanes_below': lambda a, b: np.concatenate([[np.iinfo(a.dtype).max], a[:-1]]).astype(a.dtype),
    'lanes_above': lambda a, b: np.concatenate([a[1:], [np.iinfo(a.dtype).max]]).astype(a.dtype),
    'where_less': lambda a, b: np.where(a < b, a, 0).astype(a.dtype),
    'where_at_most': lambda a, b: np.where(a <= b, b, 0).astype(a.dtype),
    'where_equal_wide': lambda a, b: np.where(a == b, b, 0).astype(a.dtype),
    'load_wide': lambda a, b: a,
    'splat_wide': lambda a, b: np.full_like(a, b[0]),
}


def clipped(values, kind):
    return np.clip(values, 0, np.iinfo(kind).max).astype(kind)


def values(kind, lanes, seed):
    """A vector's worth over the whole range, both ends among them."""
    limits = np.iinfo(kind)
    inner = np.random.default_rng(seed).integers(limits.min, limits.max, lanes - 2, kind, endpoint=True)
    return np.random.default_rng(seed).permutation(np.concatenate([inner, np.array([limits.min, limits.max], kind)]))


def operands(kind, lanes):
    """Two vectors; every fourth lane is the same in both."""
    a, b = values(kind, lanes, 1), values(kind, lanes, 2)
    b[::4] = a[::4]
    return a, b


def surrounded(vector):
    return np.concatenate([np.full(OFFSET, 7, vector.dtype), vector, np.full(BEHIND, 7, vector.dtype)])


def lanes_of(lanes):
    return (0,) * (lanes // wide.UNIT)


@numba.njit
def all_lanewise(x, y, to, pitch, lanes):
    a, b = wide.load_wide(x, OFFSET, lanes), wide.load_wide(y, OFFSET, lanes)
    wide.store_wide(to, 0 * pitch + OFFSET, a + b)
    wide.store_wide(to, 1 * pitch + OFFSET, a - b)
    wide.store_wide(to, 2 * pitch + OFFSET, a * b)
    wide.store_wide(to, 3 * pitch + OFFSET, a | b)
    wide.store_wide(to, 4 * pitch + OFFSET, a & b)
    wide.store_wide(to, 5 * pitch + OFFSET, wide.add_saturated(a, b))
    wide.store_wide(to, 6 * pitch + OFFSET, wide.subtract_saturated(a, b))
    wide.store_wide(to, 7 * pitch + OFFSET, wide.minimum_wide(a, b))
    wide.store_wide(to, 8 * pitch + OFFSET, wide.maximum_wide(a, b))
    wide.store_wide(to, 9 * pitch + OFFSET, wide.average(a, b))
    wide.store_wide(to, 10 * pitch + OFFSET, instructions.multiply_high(a, b))
    wide.store_wide(to, 11 * pitch + OFFSET, wide.shift_right(a, 3))
    wide.store_wide(to, 12 * pitch + OFFSET, wide.lanes_below(a))
    wide.store_wide(to, 13 * pitch + OFFSET, wide.lanes_above(a))
    wide.store_wide(to, 14 * pitch + OFFSET, wide.where_less(a, b, a))
    wide.store_wide(to, 15 * pitch + OFFSET, wide.where_at_most(a, b, b))
    wide.store_wide(to, 16 * pitch + OFFSET, wide.where_equal_wide(a, b, b))
    wide.store_wide(to, 17 * pitch + OFFSET, a)
    wide.store_wide(to, 18 * pitch + OFFSET, wide.splat_wide(y[OFFSET], lanes))


@numba.njit
def lanewise(x, y, to, lanes):
    all_lanewise(pointer(x), pointer(y), pointer(to), to.shape[1], lanes)


@functools.cache
def results(kind, lanes):
    """By name what each lanewise function gives for `operands`, with the numbers around it."""
    to = np.full((len(EXPECTED), OFFSET + lanes + BEHIND), 7, kind)
    lanewise(*map(surrounded, operands(kind, lanes)), to, lanes_of(lanes))
    return dict(zip(EXPECTED, to, strict=True))


@pytest.mark.parametrize('name', EXPECTED)
@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('lanes', LANES)
def test_each_lane_is_that_of_numpy_and_nothing_else_is_written(lanes, kind, name):
    with np.errstate(over='ignore'):
        expected = EXPECTED[name](*operands(kind, lanes))
    assert expected.dtype == kind
    np.testing.assert_array_equal(results(kind, lanes)[name], surrounded(expected))


@numba.njit
def reductions(array, value, lanes):
    a = wide.load_wide(pointer(array), OFFSET, lanes)
    return wide.least_wide(a), wide.sum_wide(a), wide.first_equal_wide(a, value)


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('lanes', LANES)
def test_the_least_the_sum_and_the_first_equal_lane(lanes, kind):
    a = np.maximum(values(kind, lanes, 3), 9)
    for lane in (0, 1, 15, lanes // 2 - 1, lanes // 2, lanes - 1):
        here = a.copy()
        here[lane:] = np.maximum(here[lane:], 10)
        here[:lane] = np.maximum(here[:lane], 10)
        here[lane] = here[-1] = 9  # the first of equals counts
        assert reductions(surrounded(here), kind(9), lanes_of(lanes)) == (9, here.sum(dtype=np.int64), lane)
    most = np.full(lanes, np.iinfo(kind).max, kind)
    assert reductions(surrounded(most), most[0], lanes_of(lanes)) == (most[0], most.sum(dtype=np.int64), 0)


@numba.njit
def conversions(x, y, z, small, large, lanes):
    """Of uint8 x, uint16 y and two vectors z of int16: what is of 8 bits to small, of 16 to large."""
    a, b = wide.load_wide(pointer(x), 0, lanes), wide.load_wide(pointer(y), 0, lanes)
    c, d = wide.load_wide(pointer(z[0]), 0, lanes), wide.load_wide(pointer(z[1]), 0, lanes)
    wide.store_wide(pointer(large[0]), 0, wide.widen(a))
    wide.store_wide(pointer(large[1]), 0, wide.absolute_difference(c, d))
    wide.store_wide(pointer(large[2]), 0, wide.where_less(c, d, b))
    wide.store_wide(pointer(large[3]), 0, wide.subtract_signed(c, d))
    wide.store_wide(pointer(large[4]), 0, wide.shift_right_signed(wide.as_signed(b), 3))
    wide.store_wide(pointer(large[5]), 0, wide.magnitude(c))
    wide.store_wide(pointer(small[16]), 0, wide.narrow_wide(wide.shift_right(b, 8)))
    wide.store_wide(pointer(small[17]), 0, wide.where_less(b, wide.widen(a), a))
    nibbles = wide.shift_right(a, 4)
    for own in range(16):
        wide.store_wide(pointer(small[own]), 0, instructions.differing_bits(np.uint8(own), nibbles))


@pytest.mark.parametrize('lanes', LANES)
def test_lanes_become_wider_and_narrower_and_signed_ones_differences(lanes):
    x, y = values(np.uint8, lanes, 4), values(np.uint16, lanes, 5)
    y[::2] //= 256
    z = np.array([values(np.int16, lanes, 6), values(np.int16, lanes, 7)])
    z[:, 1] = -2**15, 2**15 - 1
    small, large = np.zeros((18, lanes), np.uint8), np.zeros((6, lanes), np.uint16)
    conversions(x, y, z, small, large, lanes_of(lanes))
    np.testing.assert_array_equal(large[0], x)
    np.testing.assert_array_equal(large[1], np.abs(z[0].astype(int) - z[1]))
    np.testing.assert_array_equal(large[2], np.where(z[0] < z[1], y, 0))
    np.testing.assert_array_equal(large[3].view(np.int16), (z[0].astype(int) - z[1]).clip(-2**15, 2**15 - 1))
    np.testing.assert_array_equal(large[4].view(np.int16), y.view(np.int16) >> 3)
    np.testing.assert_array_equal(large[5], np.abs(z[0].astype(int)))
    np.testing.assert_array_equal(small[16], y >> 8)
    np.testing.assert_array_equal(small[17], np.where(y < x, x, 0))
    for own in range(16):
        np.testing.assert_array_equal(small[own], np.bitwise_count(x >> 4 ^ own))


def test_vectors_are_as_wide_as_the_search_range_and_no_wider_than_a_step():
    for disparities in range(1, 1025):
        width = wide.width_of(wide.lanes_for(disparities))
        step = 32 if disparities <= 96 else 64
        assert disparities <= width < disparities + step and width % step == 0


def test_every_function_is_tested_here():
    text = Path(__file__).read_text()
    public = {name for name, value in vars(wide).items()
              if type(value).__name__ == '_Intrinsic' and not name.startswith('_')}
    assert len(public) >= 19 and {name for name in public if f'wide.{name}(' not in text} == set()


MATCHED = '''
import hashlib, sys
sys.path.insert(0, "test/support")
from scenes import noise
from svdm_core import StereoMatcher, load_preset
result = StereoMatcher(load_preset("fast"), 1).compute(noise(30, 70), noise(30, 70, seed=1))
print(hashlib.sha256(result.disparity.tobytes() + result.valid.tobytes()).hexdigest())'''


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_a_processor_without_the_table_look_up_gives_the_same_bytes(tmp_path):
    """In processes of their own: numba settles what it compiles for when it is loaded."""
    other = {'NUMBA_CPU_NAME': 'haswell', 'NUMBA_CPU_FEATURES': '', 'NUMBA_CACHE_DIR': str(tmp_path)}
    digests = {
        subprocess.run([sys.executable, '-c', MATCHED], cwd=CHECKOUT, check=True, capture_output=True, text=True,
                       env={**os.environ, **changes}).stdout
        for changes in ({}, other)
    }
    assert len(digests) == 1 and len(digests.pop()) == 65
