"""What concerns the whole process happens when it is asked for, and not before."""
import os
import subprocess
import sys

import pytest
from checkout import CHECKOUT

WAITING = ('GOMP_SPINCOUNT', 'OMP_WAIT_POLICY')


def printed(code, **environment):
    """What a process of its own prints, without the tests' own settings of the waiting."""
    others = {name: value for name, value in os.environ.items() if name not in WAITING}
    return subprocess.run([sys.executable, '-c', code], cwd=CHECKOUT, check=True, capture_output=True, text=True,
                          timeout=60, env={**others, **environment}).stdout.strip()


@pytest.mark.parametrize(('given', 'expected'), [
    ({}, '10000'), ({'GOMP_SPINCOUNT': '7'}, '7'), ({'OMP_WAIT_POLICY': 'active'}, 'None'),
])
def test_threads_spin_briefly_unless_told_otherwise(given, expected):
    code = 'import os; from svdm_core.runtime import configure; configure(); print(os.environ.get("GOMP_SPINCOUNT"))'
    assert printed(code, **given) == expected


def test_importing_the_matcher_does_not_start_threads_that_would_not_heed_it_any_more():
    code = 'import svdm_core.matcher; print("libgomp" in open("/proc/self/maps").read(), "numba" in sys.modules)'
    assert printed(f'import sys; {code}') == 'False True'
