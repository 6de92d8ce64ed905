"""What is found at corners, beside a naive search, and what must not be taken for an offset."""
import numpy as np
import pytest
from row_scenes import HEIGHT, SEARCH, WIDTH, pair
from scenes import noise

from svdm_core import RowAlignment
from svdm_core.row_alignment.measurement import grey_of, measure_rows

FIELD = RowAlignment((0.4, 0.2, -0.3, 0.5, 0.1, 0), WIDTH, HEIGHT)


def correlation(one, another):
    one, another = (patch - patch.mean() for patch in (one.astype(float), another.astype(float)))
    return (one * another).sum() / np.sqrt((one**2).sum() * (another**2).sum())


def patch_at(image, x, y):
    return image[y - 5:y + 6, x - 5:x + 6]


def test_each_point_is_where_the_patches_are_most_alike():
    left, right = pair('leaves', FIELD)
    points = measure_rows(left, right, *SEARCH)
    assert points.size > 150 and all(values.dtype == np.float64 for values in points)
    for x, y, dy in np.array(points).T[::25]:
        x, y, row = int(x), int(y), round(y + dy)
        corner = max(range(x, min(x + SEARCH[1], WIDTH - 5)),  # the point does not say which corner it is of
                     key=lambda column: correlation(patch_at(left, column, y), patch_at(right, x, row)))
        alike = [correlation(patch_at(left, corner, y), patch_at(right, x, row + step)) for step in (-1, 0, 1)]
        assert alike[1] >= 0.9 and max(alike) == alike[1]
        vertex = 0.5 * (alike[0] - alike[2]) / (alike[0] - 2 * alike[1] + alike[2])
        assert dy == pytest.approx(row - y + vertex, abs=1e-3)


def test_they_follow_the_field():
    points = measure_rows(*pair('slanted speckles', FIELD), *SEARCH)
    apart = points.dy - FIELD.offsets(points.x_right, points.y)
    assert np.median(np.abs(apart)) < 0.08 and np.abs(apart).max() < 1
    assert np.abs(points.dy).max() <= 2


def test_what_repeats_is_not_taken():
    tile = noise(20, 12, seed=3)
    image = np.tile(tile, (12, 20))
    found = measure_rows(image, image, *SEARCH)
    assert (found.x_right < 5 + 12).all()  # the image's border cuts the search to less than a period
    assert measure_rows(image, image, 0, 8).size > 0  # in less than a period nothing repeats


def test_nothing_is_like_a_flat_place():
    left = noise(HEIGHT, WIDTH)
    for right in (np.full_like(left, 255), np.zeros_like(left), np.full_like(left, 90)):
        assert measure_rows(left, right, *SEARCH).size == 0
        assert measure_rows(right, left, *SEARCH).size == 0
    faint = 100 + noise(HEIGHT, WIDTH) // 64  # of 4 levels: what a sensor's noise is like
    assert measure_rows(faint, faint, *SEARCH).size == 0


def test_few_corners_are_spread_over_the_image():
    left, right = pair('speckles', FIELD)
    left, right = left.copy(), right.copy()
    left[:, WIDTH // 3:] //= 4  # where they are strongest
    right[:, WIDTH // 3 - 9:] //= 4
    points = measure_rows(left, right, *SEARCH, most=60)
    assert 15 < points.size <= 60 and np.ptp(points.x_right) > WIDTH / 2


def test_sixteen_bits_are_stretched_and_eight_are_as_they_are():
    image = noise(30, 40)
    assert grey_of(image) is image
    deep = image.astype(np.uint16) * 10 + 3000
    deep[0, 0] = 65535  # a hot pixel
    stretched = grey_of(deep)
    assert stretched.dtype == np.uint8 and stretched.min() == 0 and stretched.max() == 255
    assert np.corrcoef(stretched.ravel()[1:], image.ravel()[1:])[0, 1] > 0.999
    assert (grey_of(np.full((3, 3), 700, np.uint16)) == 0).all()


def test_other_sizes_are_refused():
    with pytest.raises(ValueError, match='left image 30 x 40 px and right image 31 x 40 px must have the same size'):
        measure_rows(noise(40, 30), noise(40, 31), 0, 9)
