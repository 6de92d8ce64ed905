import math
import subprocess
import sys

import numpy as np
import pytest
from checkout import CHECKOUT
from hypothesis import given
from hypothesis import strategies as st

from svdm_core import chance_wrong
from svdm_core.confidence_meaning import OFFSET, SLOPE


@given(st.floats(0, 1))
def test_it_is_the_logistic_function_of_numbers_and_of_arrays(confidence):
    expected = 1 / (1 + math.exp(SLOPE * confidence - OFFSET))
    number, array = chance_wrong(confidence), chance_wrong(np.full((2, 3), confidence, np.float32))
    assert type(number) is float and number == pytest.approx(expected, rel=1e-5)
    assert array.dtype == np.float32 and array.shape == (2, 3)
    np.testing.assert_allclose(array, expected, rtol=1e-5)


def test_the_more_confident_the_less_likely_wrong_and_the_ends_are_as_the_docstring_says():
    chances = chance_wrong(np.linspace(0, 1, 100))
    assert (np.diff(chances) < 0).all() and chances.dtype == np.float32
    assert [round(float(chance), 2) for chance in (chances[0], chances[-1])] == [0.66, 0.02]
    assert chance_wrong(np.zeros((0, 4), np.float32)).shape == (0, 4)


@pytest.mark.parametrize('wrong', [-0.01, 1.01, math.nan, math.inf])
def test_what_is_no_confidence_is_refused(wrong):
    for confidence in (wrong, np.array([0.5, wrong])):
        with pytest.raises(ValueError, match=r'is not allowed: it must be within 0 \.\. 1'):
            chance_wrong(confidence)


def test_it_loads_neither_numba_nor_opencv():
    code = 'import sys, svdm_core; svdm_core.chance_wrong(0.5); print({"numba", "cv2", "yaml"} & set(sys.modules))'
    run = subprocess.run([sys.executable, '-c', code], cwd=CHECKOUT, capture_output=True, text=True, timeout=60)
    assert run.stdout == 'set()\n', run.stderr
