"""Images for the tests."""
import numpy as np


def noise(*shape, dtype=np.uint8, seed=0):
    """Independent random values over the whole range of `dtype`."""
    return np.random.default_rng(seed).integers(0, np.iinfo(dtype).max, shape, dtype, endpoint=True)


def shifted_wall(height, width, shift, seed=1):
    """Grey random-dot pair with x_left - x_right = shift everywhere."""
    wall = noise(height, width + shift, seed=seed)
    return wall[:, :width], wall[:, shift:]


def two_walls(height=60, width=90, near=12, far=4, seed=2):
    """Grey random-dot pair: a square at disparity `near` before a wall at `far`; returns left, right and the truth."""
    far_left, far_right = shifted_wall(height, width, far, seed)
    left, right = far_left.copy(), far_right.copy()
    truth = np.full((height, width), far)
    rows, columns = slice(height // 4, 3 * height // 4), slice(width // 3, 2 * width // 3)
    square = noise(height, width, seed=seed + 1)[rows, columns]
    left[rows, columns] = square
    right[rows, columns.start - near:columns.stop - near] = square
    truth[rows, columns] = near
    return left, right, truth


def labels(shape, seed, end=8):
    """Independent random disparities 0 .. end - 1, int32."""
    return np.random.default_rng(seed).integers(0, end, shape).astype(np.int32)
