import numpy as np
import pytest
from scenes import shifted_wall

from svdm_core.evaluation.opencv_matchers import OPENCV_METHODS, OpenCVMatcher


@pytest.mark.parametrize('method', OPENCV_METHODS)
@pytest.mark.parametrize('colour', [False, True])
def test_opencv_finds_a_flat_wall_and_its_dense_map_has_no_holes(method, colour):
    left, right = shifted_wall(60, 120, 9)
    if colour:
        left, right = (np.ascontiguousarray(np.repeat(image[..., None], 3, axis=2)) for image in (left, right))
    matcher = OpenCVMatcher(method, 20, 3 if colour else 1)
    inside = np.s_[10:-10, 45:-10]
    assert np.median(matcher.compute(left, right)[inside]) == pytest.approx(9, abs=0.1)
    dense = matcher.compute_dense(left, right)
    assert dense.shape == (60, 120) and dense.dtype == np.float32 and dense.min() >= 0
    assert (np.abs(dense[inside] - 9) < 0.5).mean() > 0.99


def test_an_unknown_method_is_named():
    with pytest.raises(ValueError, match="method = 'sgm' is not allowed: it must be bm"):
        OpenCVMatcher('sgm', 16, 1)
