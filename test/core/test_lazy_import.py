"""`import svdm_core` takes no time and leaves the process as it was; its names come when they are used."""
import subprocess
import sys

import pytest
from checkout import CHECKOUT

import svdm_core

IMPORT = '''
import os, signal, sys, time
environment, begin = dict(os.environ), time.perf_counter()
import svdm_core
print(time.perf_counter() - begin < 0.25)
print(signal.getsignal(signal.SIGINT) is signal.default_int_handler, dict(os.environ) == environment)
print({"numba", "numpy", "cv2", "yaml"} & set(sys.modules))'''


def test_it_is_fast_and_has_no_side_effects():
    run = subprocess.run([sys.executable, '-c', IMPORT], cwd=CHECKOUT, capture_output=True, text=True, timeout=60)
    assert run.stdout.splitlines() == ['True', 'True True', 'set()'], run.stderr


@pytest.mark.parametrize('name', svdm_core.__all__)
def test_every_name_is_there(name):
    assert name in dir(svdm_core)
    assert getattr(svdm_core, name).__name__ == name
    assert getattr(svdm_core, name).__module__.startswith('svdm_core.')


def test_a_name_that_is_not_there_is_named():
    with pytest.raises(AttributeError, match="module 'svdm_core' has no attribute 'StereoMatch'"):
        _ = svdm_core.StereoMatch
    with pytest.raises(ImportError, match='StereoMatch'):
        from svdm_core import StereoMatch  # noqa: F401
