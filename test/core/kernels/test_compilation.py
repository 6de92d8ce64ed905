"""One decorator makes all kernels, and leaves numba as it was."""
import numba
import numpy as np
import pytest
from checkout import CHECKOUT

from svdm_core.kernels.cache import cache_folder
from svdm_core.kernels.compilation import kernel

CORE = CHECKOUT / 'svdm_core'


@pytest.mark.parametrize('inline', [None, False, True])
def test_a_kernel_is_the_function_compiled_without_the_gil_and_in_the_cache_of_the_sources(inline):
    def sums(rows):
        result = np.empty(len(rows))
        for k in range(len(rows)):
            result[k] = rows[k].sum()
        return result

    before = numba.config.CACHE_DIR
    compiled = kernel(sums) if inline is None else kernel(inline=inline)(sums)
    assert before == numba.config.CACHE_DIR
    assert compiled.py_func is sums
    assert compiled.stats.cache_path.startswith(str(cache_folder()))
    assert compiled.targetoptions['nogil']
    assert compiled(np.ones((3, 4))).tolist() == [4, 4, 4]


def test_every_kernel_is_made_by_the_one_decorator():
    outside = [path.name for path in CORE.rglob('*.py') if 'njit' in path.read_text()]
    assert outside == ['compilation.py']
