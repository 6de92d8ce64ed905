"""The estimate on pairs whose field is known, and on pairs that have none or must not be corrected.

SVDM_ROW_FIELDS=200 in the environment tries as many random fields as that, in place of 30.
"""
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from row_scenes import HEIGHT, SCENES, SEARCH, WIDTH, difference, pair, random_field
from scenes import noise

from svdm_core import RowAlignment, estimate_row_alignment
from svdm_core.row_alignment.alignment import pixel_grid

FIELDS = int(os.environ.get('SVDM_ROW_FIELDS', '30'))
ENOUGH = 0.08
"""px rms over the image."""
FIELD = RowAlignment((0.3, -0.4, 0.5, 0.6, -0.2, 0.1), WIDTH, HEIGHT)
ALIGNED = RowAlignment.identity(WIDTH, HEIGHT)


@pytest.mark.parametrize('scene', SCENES)
def test_random_fields_up_to_two_pixels_are_recovered(scene):
    number = list(SCENES).index(scene)
    random = np.random.default_rng(number)
    errors = []
    for seed in range(FIELDS // len(SCENES)):
        field = random_field(random)
        errors.append(difference(estimate_row_alignment(pair(scene, field, seed), *SEARCH), field))
    assert max(errors) <= ENOUGH, errors


def test_sharp_images_do_not_draw_it_to_whole_rows():
    fine = np.random.default_rng(0).normal(0, 1, (8 * HEIGHT, WIDTH + 9))
    fine = cv2.GaussianBlur(fine, (0, 0), sigmaX=0.5, sigmaY=4)
    fine = 128 + 40 * fine / fine.std()
    left, right = (np.roll(fine, 2 * down, axis=0).reshape(HEIGHT, 8, -1).mean(1)  # a pixel sees 8 rows of it
                   for down in (0, 1))
    images = (np.clip(np.rint(image), 0, 255).astype(np.uint8) for image in (left[:, :WIDTH], right[:, 9:]))
    rows = estimate_row_alignment(tuple(images), *SEARCH)
    assert difference(rows, RowAlignment((0.25, 0, 0, 0, 0, 0), WIDTH, HEIGHT)) <= 0.02  # 0.07 after one round


def test_offsets_beyond_what_a_search_believes_are_found_in_the_next():
    field = RowAlignment((0, 0, 0, 3.4, 0, 0), WIDTH, HEIGHT)
    assert difference(estimate_row_alignment(pair('speckles', field), *SEARCH), field) <= ENOUGH


def test_the_aligned_image_is_the_one_without_the_field():
    left, right = pair('speckles', FIELD, noise=0)
    rows = estimate_row_alignment((left, right), *SEARCH)
    off, aligned = (cv2.absdiff(image, pair('speckles', ALIGNED, noise=0)[1]) for image in (right, rows.apply(right)))
    inside = np.s_[5:-5, 5:-5]
    assert aligned[inside].mean() < 1 and off[inside].mean() > 5
    assert rows.residual_after < 0.5 * rows.residual_before and rows.points > 200


@pytest.mark.parametrize('change', [
    lambda image: image.astype(np.uint16) * 257, lambda image: image.astype(np.uint16) * 16 + 300,
    lambda image: cv2.merge([image] * 3), lambda image: cv2.merge([image.astype(np.uint16) * 100] * 3)])
def test_every_kind_of_image(change):
    rows = estimate_row_alignment(tuple(map(change, pair('leaves', FIELD))), *SEARCH)
    assert difference(rows, FIELD) <= ENOUGH


def test_different_exposures_of_the_two_cameras():
    left, right = pair('leaves', FIELD)
    dark = np.clip(0.5 * right.astype(float) + 30, 0, 255).astype(np.uint8)
    assert difference(estimate_row_alignment((left, dark), *SEARCH), FIELD) <= ENOUGH
    gamma = (255 * (right / 255)**0.6).astype(np.uint8)
    assert difference(estimate_row_alignment((left, gamma), *SEARCH), FIELD) <= ENOUGH


@pytest.mark.parametrize('shift', [-40, -9, 30])
def test_any_sign_of_min_disparity(shift):
    left, right = pair('speckles', FIELD)
    moved = np.roll(right, -shift, axis=1)  # all disparities are larger by `shift`
    rows = estimate_row_alignment((left, moved), SEARCH[0] + shift, SEARCH[1])
    x, y = np.broadcast_arrays(*pixel_grid(HEIGHT, WIDTH))
    inside = (x - 60 > max(0, -shift)) & (x + 60 < WIDTH - max(0, shift))
    apart = (rows.offsets(x, y) - FIELD.offsets(x + shift, y))[inside]
    assert np.sqrt(np.mean(apart**2)) <= ENOUGH


def test_the_same_images_give_the_same_alignment_and_are_left_alone():
    left, right = pair('two walls', FIELD)
    before = left.copy(), right.copy()
    for image in (left, right):
        image.flags.writeable = False
    assert estimate_row_alignment((left, right), *SEARCH) == estimate_row_alignment([(left, right)], *SEARCH)
    np.testing.assert_array_equal((left, right), before)


def test_several_pairs_tell_what_one_alone_cannot():
    pairs = []
    for seed, (across, down) in enumerate([(0, 0), (1, 0), (0, 1), (1, 1)]):  # each has texture in a quarter only
        mask = np.zeros((HEIGHT, WIDTH), bool)
        mask[down * HEIGHT // 2:(down + 1) * HEIGHT // 2, across * WIDTH // 2:(across + 1) * WIDTH // 2] = True
        pairs.append(tuple(np.where(mask, image, 128).astype(np.uint8) for image in pair('speckles', FIELD, seed)))
    assert [estimate_row_alignment(one, *SEARCH) for one in pairs] == [None] * 4
    assert difference(estimate_row_alignment(iter(pairs), *SEARCH), FIELD) <= 2 * ENOUGH  # the rims are seen badly


def repetitive(random):
    wave = 128 + 60 * np.sin(np.arange(WIDTH) / 2)[None] * np.sin(np.arange(HEIGHT) / 2)[:, None]
    return tuple(np.clip(wave + random.normal(0, 3, wave.shape), 0, 255).astype(np.uint8) for _ in range(2))


def stripes(random):
    wave = np.repeat(128 + 60 * np.sin(np.arange(WIDTH) / 3)[None], HEIGHT, axis=0)
    return tuple(np.clip(wave + random.normal(0, 3, wave.shape), 0, 255).astype(np.uint8) for _ in range(2))


def textureless(random):
    return tuple(np.clip(random.normal(100, 2, (HEIGHT, WIDTH)), 0, 255).astype(np.uint8) for _ in range(2))


def blank(_):
    return (np.zeros((HEIGHT, WIDTH), np.uint8),) * 2


def identical(_):
    return (pair('leaves', ALIGNED)[0],) * 2


def few_points(_):
    return tuple(np.where(np.arange(WIDTH) < 70, image, 90).astype(np.uint8)[:60] for image in pair('leaves', FIELD))


def in_one_corner(_):
    corner = (np.arange(WIDTH) < WIDTH // 2) & (np.arange(HEIGHT)[:, None] < HEIGHT // 2)
    return tuple(np.where(corner, image, 90).astype(np.uint8) for image in pair('speckles', FIELD))


def of_scene(change):
    return lambda _: (lambda left, right: (left, np.ascontiguousarray(change(right))))(*pair('leaves', ALIGNED))


def saturated(random):
    left, right = pair('leaves', FIELD)
    return tuple(np.where(image > 100, 255, image // 50 * 50).astype(np.uint8) for image in (left, right))


def far_off(_):
    left, right = pair('speckles', ALIGNED)
    return left, np.roll(right, 5, axis=0)


NOTHING = {
    'repetitive': repetitive, 'stripes': stripes, 'textureless': textureless, 'blank': blank, 'identical': identical,
    'few points': few_points, 'in one corner': in_one_corner, 'far off': far_off,
    'aligned': lambda _: pair('leaves', ALIGNED), 'aligned speckles': lambda _: pair('speckles', ALIGNED, noise=4),
    'flipped': of_scene(lambda right: right[::-1]), 'mirrored': of_scene(lambda right: right[:, ::-1]),
    'turned by 180': of_scene(lambda right: right[::-1, ::-1]), 'inverted': of_scene(lambda right: 255 - right),
    'another scene': lambda _: (pair('leaves', ALIGNED, 1)[0], pair('leaves', ALIGNED, 2)[1]),
    'noise': lambda random: tuple(random.integers(0, 256, (2, HEIGHT, WIDTH), np.uint8)),
}


@pytest.mark.parametrize('name', NOTHING)
def test_no_correction_where_there_is_nothing_to_be_told(name):
    assert estimate_row_alignment(NOTHING[name](np.random.default_rng(0)), *SEARCH) is None


@pytest.mark.parametrize('angle', [0.1, 0.3, 1, 5, 90])
def test_a_turned_image_gets_the_right_correction_or_none(angle):
    left, right = pair('speckles', ALIGNED)
    turn = cv2.getRotationMatrix2D((WIDTH / 2, HEIGHT / 2), angle, 1)
    rows = estimate_row_alignment((left, cv2.warpAffine(right, turn, (WIDTH, HEIGHT), flags=cv2.INTER_CUBIC)), *SEARCH)
    expected = RowAlignment((0, -np.tan(np.radians(angle)) * WIDTH / 2, 0, 0, 0, 0), WIDTH, HEIGHT) \
        if angle <= 1 else None
    assert rows is None or difference(rows, expected) <= ENOUGH
    assert rows is not None or angle > 0.3


def test_a_saturated_pair_gets_the_right_correction_or_none():
    rows = estimate_row_alignment(saturated(None), *SEARCH)
    assert rows is None or difference(rows, FIELD) <= 2 * ENOUGH


@pytest.mark.parametrize('shape', [(1, 1), (1, 300), (300, 1), (12, 12), (27, 11), (28, 40), (40, 28, 3)])
@pytest.mark.parametrize('search', [(0, 1), (-1024, 1024), (1024, 1024), (-5, 3)])
def test_tiny_images_and_any_search_range(shape, search):
    images = noise(*shape, seed=1), noise(*shape, seed=2)
    assert estimate_row_alignment(images, *search) is None
    assert estimate_row_alignment(tuple(image.astype(np.uint16) for image in images), *search) is None


def test_no_pairs_are_nothing_and_other_sizes_are_refused():
    assert estimate_row_alignment([], *SEARCH) is None
    with pytest.raises(ValueError, match='images of 30 x 40 and 31 x 40 px: all must have the same size'):
        estimate_row_alignment((noise(40, 30), noise(40, 31)), *SEARCH)
    with pytest.raises(ValueError, match='images of 31 x 40 and 30 x 40 px'):
        estimate_row_alignment([(noise(40, 30),) * 2, (noise(40, 31),) * 2], *SEARCH)


# Real pairs


def street():
    folder = Path(os.environ.get('SVDM_DATA', 'unset')) / 'kitti_odometry_seq1'
    if not folder.is_dir():
        pytest.skip('SVDM_DATA names no folder with kitti_odometry_seq1')
    names = sorted(path.name for path in (folder / 'left').iterdir())
    return [tuple(cv2.imread(str(folder / side / name), cv2.IMREAD_GRAYSCALE) for side in ('left', 'right'))
            for name in names]


@pytest.mark.slow
def test_two_halves_of_a_drive_have_the_same_field():
    pairs = street()
    first, second = (estimate_row_alignment(part, 0, 128) for part in (pairs[:26], pairs[26:]))
    x, y = pixel_grid(first.height, first.width)
    assert np.sqrt(np.mean((first.offsets(x, y) - second.offsets(x, y))**2)) <= 0.1
    assert first.coefficients[3] == pytest.approx(1.5, abs=0.15)
    assert first.residual_after < 0.3 * first.residual_before
