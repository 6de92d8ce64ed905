"""The figure that needs no ground truth, against its definition pixel by pixel."""
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import two_walls

from svdm_core.evaluation.reconstruction import reconstruction, textured_share, visible


def at(image, row, column):
    """Beyond the border the outermost pixel counts."""
    height, width = image.shape
    return float(image[min(max(row, 0), height - 1), min(max(column, 0), width - 1)])


def sampled(image, row, x):
    x = min(max(x, 0.0), image.shape[1] - 1.0)
    first = int(np.floor(x))
    return at(image, row, first) + (x - first) * (at(image, row, first + 1) - at(image, row, first))


def naive(disparity, left, right):
    height, width = disparity.shape
    moved = np.array([[sampled(right, y, x - disparity[y, x]) for x in range(width)] for y in range(height)])
    total = 0.0
    for y in range(height):
        lands = [round(float(np.float32(x) - np.float32(disparity[y, x]))) for x in range(width)]
        for x in range(width):
            others = [disparity[y, other] for other in range(width) if lands[other] == lands[x]]
            if not 0 <= lands[x] < width or disparity[y, x] < max(others) - 1:
                total += 0.5
                continue
            slopes = [(at(image, y, x + 1) - at(image, y, x - 1)) / 2 for image in (left, moved)]
            differ = [(at(left, y + dy, x + dx) < left[y, x]) != (at(moved, y + dy, x + dx) < moved[y, x])
                      for dy in range(-3, 4) for dx in range(-4, 5)]
            total += min(abs(slopes[0] - slopes[1]), 8) / 8 / 2 + sum(differ) / 62 / 2
    jumps = 0.0
    for dy, dx in ((0, 1), (1, 0)):
        pairs = [(y, x) for y in range(height - dy) for x in range(width - dx)]
        unexplained = [abs(disparity[y + dy, x + dx] - disparity[y, x]) > 1
                       and abs(float(left[y + dy, x + dx]) - float(left[y, x])) <= 10 for y, x in pairs]
        jumps += sum(unexplained) / len(pairs) if pairs else 0
    return 100 * total / disparity.size, 100 * jumps


@settings(max_examples=30, deadline=None)
@given(st.integers(2, 9), st.integers(2, 14), st.integers(0, 2**32 - 1))
def test_it_is_what_its_definition_says(height, width, seed):
    rng = np.random.default_rng(seed)
    left, right = (rng.integers(0, 40, (height, width), dtype=np.uint8) for _ in range(2))
    # Eighths, so that float32 and float64 agree to the bit; no halves, at which rounding could differ.
    disparity = (rng.integers(0, 8 * 4, (height, width)) / 8).astype(np.float32)
    disparity[disparity % 1 == 0.5] += 0.125
    found = reconstruction(disparity, left, right)
    assert (found.mismatch, found.jumps) == pytest.approx(naive(disparity, left, right), rel=1e-4, abs=1e-4)


def test_the_truth_is_better_than_what_is_wrong_and_than_a_constant():
    left, right, truth = two_walls(60, 90, near=9, far=3, seed=1)
    rng = np.random.default_rng(0)
    right_map = sum(reconstruction(truth, left, right))
    for wrong in (truth + 1, truth - 2, np.full_like(truth, 3), np.full_like(truth, 0),
                  truth + rng.integers(-3, 4, truth.shape)):
        assert sum(reconstruction(wrong, left, right)) > 1.1 * right_map


def test_colour_is_as_grey_where_it_has_none_and_sixteen_bits_as_eight():
    left, right, truth = two_walls(40, 60, near=9, far=3, seed=2)
    grey = reconstruction(truth, left, right)
    colour = reconstruction(truth, *(np.repeat(image[..., None], 3, 2) for image in (left, right)))
    wide = reconstruction(truth, *(image.astype(np.uint16) * 257 for image in (left, right)))
    assert colour == pytest.approx(grey) and wide == pytest.approx(grey, rel=0.05)


def test_what_is_hidden_is_read_off_the_map():
    disparity = np.zeros((1, 8), np.float32)
    disparity[0, 4:6] = 3  # lands on columns 1 and 2, before what was there
    assert visible(disparity).tolist() == [[True, False, False, True, True, True, True, True]]
    assert not visible(np.full((1, 4), 9, np.float32)).any()


def test_texture_is_a_share():
    plain, noisy = np.full((20, 30), 99, np.uint8), np.random.default_rng(0).integers(0, 256, (20, 30), dtype=np.uint8)
    assert textured_share(plain) == 0 and textured_share(noisy) > 90


@pytest.mark.parametrize(('disparity', 'words'), [
    (np.zeros((4, 4), np.float32), 'must have the same height and width'),
    (np.full((5, 6), np.nan, np.float32), 'must be dense'),
    (np.full((5, 6), np.inf, np.float32), 'must be dense'),
])
def test_what_does_not_fit_is_refused(disparity, words):
    image = np.zeros((5, 6), np.uint8)
    with pytest.raises(ValueError, match=words):
        reconstruction(disparity, image, image)
