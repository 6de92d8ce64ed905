import cv2
import numpy as np
import pytest
from stages import run, task_phase

from svdm_core.disparity_refinement.byte_median import STEPS
from svdm_core.disparity_refinement.final_median import SmoothedMap, scratch_size, smooth_map, sorting_network
from svdm_core.kernels.stripes import block_count


def smoothed(fixed, side, min_disparity):
    """The map in px; and the same in 1 / STEPS px, which must agree."""
    disparity, medians = np.full(fixed.shape, 9, np.float32), np.full(fixed.shape, 9, np.uint16)
    for to in (SmoothedMap(medians, disparity[:0, :0]), SmoothedMap(medians[:0, :0], disparity)):
        run(task_phase(block_count(len(fixed)), smooth_map, fixed, side, min_disparity, to,
                       scratch=scratch_size(fixed.shape[1])))
    np.testing.assert_array_equal(medians / np.float32(STEPS) + min_disparity, disparity)
    return disparity


@pytest.mark.parametrize('end', [1, 5, 2**16])
@pytest.mark.parametrize('min_disparity', [-20, 0, 5])
@pytest.mark.parametrize('side', [1, 3, 5])
@pytest.mark.parametrize('shape', [(1, 1), (1, 6), (40, 2), (9, 33), (16, 16), (17, 15)])
def test_the_median_is_opencvs(shape, side, min_disparity, end):
    fixed = np.random.default_rng(side).integers(0, end, shape).astype(np.uint16)
    expected = (cv2.medianBlur(fixed, side) if side > 1 else fixed) / np.float32(STEPS) + min_disparity
    np.testing.assert_array_equal(smoothed(fixed, side, min_disparity), expected)


@pytest.mark.parametrize('size', [1, 2, 3, 9, 25])
def test_the_network_sorts_all_of_zeros_and_ones(size):
    """Then it sorts everything (Knuth)."""
    rng = np.random.default_rng(1)
    every = np.arange(2**size)[:, None] >> np.arange(size) & 1 if size < 12 else rng.integers(0, 2, (4000, size))
    values = every.T.copy()
    for low, high in sorting_network(size):
        assert 0 <= low < high < size
        values[[low, high]] = np.minimum(values[low], values[high]), np.maximum(values[low], values[high])
    assert (np.diff(values, axis=0) >= 0).all()
