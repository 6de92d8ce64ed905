import numpy as np
import pytest

from svdm_core.kernels.arrays import aligned_zeros


@pytest.mark.parametrize('dtype', [np.uint8, np.uint16, np.float32])
@pytest.mark.parametrize('shape', [(0,), (1,), (2, 0), (3, 5, 7)])
def test_zeros_begin_with_a_cache_line(shape, dtype):
    for _ in range(5):
        zeros = aligned_zeros(shape, dtype)
        assert zeros.shape == shape and zeros.dtype == dtype and zeros.flags.c_contiguous and zeros.flags.writeable
        assert zeros.ctypes.data % 64 == 0 or not zeros.size
        assert not zeros.any()
