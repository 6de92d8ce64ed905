import numpy as np
import pytest

from svdm_core.evaluation import streaks
from svdm_core.evaluation.streaks import LENGTH, THICKNESS, streak_mask, streak_share

SHAPE = (40, 60)


def flat_image(*channels, dtype=np.uint8):
    return np.full((*SHAPE, *channels), 100, dtype)


def wall(value=20.0):
    return np.full(SHAPE, value, np.float32)


def test_a_constant_map_has_none():
    assert streak_share(wall(), flat_image()) == 0


@pytest.mark.parametrize('offset', [-3, -1.25, 1.25, 3])
@pytest.mark.parametrize('thickness', [1, 2, THICKNESS])
@pytest.mark.parametrize('channels', [(), (3,)])
def test_a_streak_is_found_whole_and_nothing_else(offset, thickness, channels):
    disparity = wall()
    disparity[10:10 + thickness, 20:45] += offset
    np.testing.assert_array_equal(streak_mask(disparity, flat_image(*channels)), disparity != 20)
    assert streak_share(disparity, flat_image(*channels)) == pytest.approx(100 * 25 * thickness / disparity.size)


@pytest.mark.parametrize(('rows', 'columns', 'offset'), [
    (slice(10, 11), slice(20, 20 + LENGTH - 1), 3),  # too short
    (slice(10, 11 + THICKNESS), slice(20, 45), 3),  # too thick
    (slice(10, 11), slice(20, 45), 1),  # too small a step
    (slice(0, 1), slice(0, 60), 3),  # nothing above
    (slice(39, 40), slice(0, 60), 3),  # nothing below
    (slice(10, 40), slice(0, 60), 3),  # a step
    (slice(0, 40), slice(20, 23), 3),  # vertical
    (slice(0, 40), slice(20, 45), 9),  # an object from top to bottom
])
def test_what_is_no_streak(rows, columns, offset):
    disparity = wall()
    disparity[rows, columns] += offset
    assert streak_share(disparity, flat_image()) == 0


def test_the_shortest_streak_counts_also_at_the_left_and_right_border():
    for columns in (slice(0, LENGTH), slice(20, 20 + LENGTH), slice(-LENGTH, None)):
        disparity = wall()
        disparity[10, columns] += 3
        assert streak_mask(disparity, flat_image()).sum() == LENGTH


@pytest.mark.parametrize('slope', [0.3, 1.0, 2.5])
@pytest.mark.parametrize('axis', [0, 1])
@pytest.mark.parametrize('rounded', [False, True])
def test_slanted_planes_have_none(slope, axis, rounded):
    plane = slope * np.indices(SHAPE)[axis].astype(np.float32)
    for disparity in (plane, 60 - plane):
        assert streak_share(np.round(disparity) if rounded else disparity, flat_image()) == 0


def test_what_the_image_shows_does_not_count():
    disparity = wall()
    disparity[10:13, 20:45] += 3
    image = flat_image(3)
    image[10:13, 20:45, 1] += streaks.IMAGE_STEP
    assert streak_mask(disparity, image).sum() == 3 * 25
    image[10:13, 20:45, 1] += 1
    assert streak_share(disparity, image) == 0
    image = flat_image()
    image[13:] = 200  # an edge on one side is enough
    assert streak_share(disparity, image) == 0


def test_sixteen_bits_count_like_eight():
    disparity = wall()
    disparity[10, 20:45] += 3
    image = flat_image().astype(np.uint16) * 257
    image[10] += streaks.IMAGE_STEP * 257
    assert streak_mask(disparity, image).sum() == 25
    image[10] += 1
    assert streak_share(disparity, image) == 0


def test_nearer_and_farther_pieces_are_not_one_streak():
    disparity = wall()
    disparity[10, 20:26] += 3
    disparity[10, 26:32] -= 3
    assert streak_share(disparity, flat_image()) == 0


def test_neighbouring_rows_that_differ_from_each_other():
    disparity = wall()
    disparity[10, 20:45] += 3
    disparity[11, 20:45] -= 3  # both stand out
    np.testing.assert_array_equal(streak_mask(disparity, flat_image()), disparity != 20)


def test_next_to_unknown_disparities_there_is_none():
    disparity = wall()
    disparity[10, 20:45] += 3
    for unknown in (np.nan, np.inf):
        disparity[9] = unknown
        assert streak_share(disparity, flat_image()) == 0


def test_images_that_do_not_fit_are_named():
    with pytest.raises(ValueError, match=r'disparity \(40, 60\) and image \(40, 59\) must have the same height'):
        streak_mask(wall(), flat_image()[:, 1:])
    with pytest.raises(ValueError, match='must have the same'):
        streak_mask(np.zeros((0, 4)), np.zeros((0, 4), np.uint8))


def test_against_a_walk_down_each_column():
    rng = np.random.default_rng(5)
    disparity = np.repeat(rng.integers(10, 14, (40, 4)), 15, axis=1).astype(np.float32)
    disparity[:, 20:22] += rng.integers(0, 3, (40, 2))
    image = rng.integers(100, 112, SHAPE, np.uint8)
    image[:, :30] = 100
    found = streak_mask(disparity, image)
    np.testing.assert_array_equal(found, _walked(disparity, image))
    assert found.any()


def _walked(disparity, image):
    """The definition, pixel by pixel."""
    height, width = disparity.shape
    image = image.astype(int)
    side = np.zeros((height, width))
    for y, x in np.ndindex(height, width):
        d, shown, top, bottom = disparity[:, x], image[:, x], y, y
        while top > 0 and abs(d[top] - d[top - 1]) <= streaks.DISPARITY_STEP:
            top -= 1
        while bottom < height - 1 and abs(d[bottom + 1] - d[bottom]) <= streaks.DISPARITY_STEP:
            bottom += 1
        if top == 0 or bottom == height - 1 or bottom - top + 1 > THICKNESS:
            continue
        rise = d[top] - d[top - 1], d[bottom] - d[bottom + 1]
        edge = max(abs(shown[top] - shown[top - 1]), abs(shown[bottom] - shown[bottom + 1]))
        if rise[0] * rise[1] > 0 and edge <= streaks.IMAGE_STEP:
            side[y, x] = np.sign(rise[0])
    result = np.zeros((height, width), bool)
    for y, x in np.ndindex(height, width - LENGTH + 1):
        run = side[y, x:x + LENGTH]
        if run[0] != 0 and (run == run[0]).all():
            result[y, x:x + LENGTH] = True
    return result
