import numpy as np

from svdm_core.disparity_optimization.penalties import FROM_ABOVE, FROM_LEFT, fill_penalties, penalties_shape


def test_a_penalty_is_halved_at_an_edge_of_p2_edge_and_never_below_p1():
    image = np.zeros((3, 4, 3), np.uint8)
    image[:, 2:, 1] = 20
    image[2, :, 2] = 180
    penalties = np.zeros(penalties_shape(3, 4), np.uint16)
    fill_penalties(image, image, 30, 200, 20.0, penalties)
    left, mirrored = penalties.reshape(2, 2, 4, 4)
    np.testing.assert_array_equal(left[FROM_LEFT, :3, 1:], [[200, 100, 200]] * 3)
    np.testing.assert_array_equal(mirrored[FROM_LEFT, :3, 1:], [[200, 100, 200]] * 3)
    np.testing.assert_array_equal(left[FROM_ABOVE, 1:3], [[200] * 4, [30] * 4])
