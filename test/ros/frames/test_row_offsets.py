"""How far rows are apart: rendered pairs of known offset, pairs that say nothing, and the real sequence."""
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import noise

from svdm_core import RowAlignment
from svdm_core.row_alignment.alignment import RowPoints
from svdm_ros.frames import row_offsets as module
from svdm_ros.frames.row_offsets import RectificationCheck, RowOffsets, row_offsets, row_points

SEARCH = (0, 63)
HEIGHT, WIDTH = 300, 400


def texture(x, y, seed=0):
    """Grey levels of a smooth random texture at any places (x, y) in px: waves 6 px long and longer."""
    random = np.random.default_rng(seed)
    total = np.zeros(np.shape(x))
    for _ in range(60):
        frequency, direction, phase = 2 * np.pi / random.uniform(6, 40), *random.uniform(0, 2 * np.pi, 2)
        total += np.sin(frequency * (np.cos(direction) * x + np.sin(direction) * y) + phase)
    return np.clip(128 + 20 * total, 0, 255)


def rendered(down=0.0, seed=0, turn=0.0, height=HEIGHT, width=WIDTH):
    """Left and right image (uint8), disparities 10 to 30 px; the right one `down` px lower, turned by `turn` degrees.

    Nothing is interpolated: each pixel is a value of the texture.
    """
    y, x = np.mgrid[:height, :width].astype(float)
    angle = np.radians(turn)
    across, along = x - width / 2, y - height / 2
    x_seen = width / 2 + np.cos(angle) * across + np.sin(angle) * along
    y_seen = height / 2 - np.sin(angle) * across + np.cos(angle) * along - down
    disparity = 20 + 6 * np.sin(x_seen / 60) + 4 * np.cos(y_seen / 50)
    left, right = texture(x, y, seed), texture(x_seen + disparity, y_seen, seed)
    return left.round().astype(np.uint8), right.round().astype(np.uint8)


def in_colour(image):
    return np.dstack((image // 2, image, 255 - image // 3))


def found_in(left, right, search):
    points = row_points(left, right, search)
    return None if points is None else row_offsets(points)


# What is measured


@pytest.mark.parametrize('down', [0, 0.3, -0.7, 1.5, 4, -9, 10])
def test_a_known_offset_is_found(down):
    found = found_in(*rendered(down), SEARCH)
    assert abs(found.median - down) < 0.1
    assert abs(found.p90 - abs(down)) < 0.25
    assert found.features >= 80


@pytest.mark.parametrize('change', [
    lambda image: image.astype(np.uint16) * 257,
    lambda image: image.astype(np.uint16) * 8 + 500,
    in_colour,
    lambda image: in_colour(image).astype(np.uint16) * 16,
], ids=['16 bits', '12 bits in 16', 'colour', '16-bit colour'])
def test_all_types_of_images(change):
    found = found_in(*map(change, rendered(-0.7)), SEARCH)
    assert abs(found.median + 0.7) < 0.1 and found.features >= 80


def test_the_exposure_of_one_camera_moves_nothing():
    left, right = rendered(0.3)
    found = found_in(left, (0.5 * right + 60).astype(np.uint8), SEARCH)
    assert abs(found.median - 0.3) < 0.1 and found.p90 < 0.6


def test_verged_cameras_and_a_wide_search():
    left, right = rendered(1.5)
    mirrored = found_in(np.ascontiguousarray(left[:, ::-1]), np.ascontiguousarray(right[:, ::-1]), (-40, 0))
    wide = found_in(left, right, (-1024, 2046))
    for found in (mirrored, wide):
        assert abs(found.median - 1.5) < 0.1 and found.features >= 20


def test_a_search_that_has_not_the_disparities_finds_nothing():
    assert found_in(*rendered(), (60, 90)) is None


def test_identical_images_are_0_px_apart():
    left, _ = rendered()
    found = found_in(left, left, SEARCH)
    assert abs(found.median) < 0.01 and found.p90 < 0.1 and found.features >= 80


def test_a_turned_image_has_a_large_90th_percentile():
    found = found_in(*rendered(turn=1.5), SEARCH)
    assert abs(found.median) < 1
    assert 3 < found.p90 < 200 * np.sin(np.radians(1.5))


def test_a_few_objects_at_other_heights_are_outliers():
    left, right = rendered()
    right[100:200, 100:200] = right[103:203, 100:200]
    found = found_in(left, right, SEARCH)
    assert abs(found.median) < 0.1 and found.p90 < 0.5


def test_the_same_images_give_the_same_result():
    left, right = rendered(0.3)
    first = found_in(left, right, SEARCH)
    assert all(found_in(left.copy(), right.copy(), SEARCH) == first for _ in range(3))


# Pairs that say nothing


@pytest.mark.parametrize('pair', [
    (np.full((HEIGHT, WIDTH), 90, np.uint8),) * 2,
    (np.full((HEIGHT, WIDTH, 3), 4000, np.uint16),) * 2,
    (noise(HEIGHT, WIDTH, seed=1), noise(HEIGHT, WIDTH, seed=2)),
    (rendered(seed=1)[0], rendered(seed=2)[0]),
    (rendered()[0], rendered()[1][::-1]),
    (noise(5, 5),) * 2,
    (noise(HEIGHT, WIDTH), noise(HEIGHT, WIDTH + 1)),
], ids=['constant', 'constant colour', 'other noise', 'other texture', 'flipped', '5x5', 'other size'])
def test_nothing_is_found(pair):
    assert found_in(*pair, SEARCH) is None


def test_a_ramp_has_no_corners():
    ramp = np.tile(np.linspace(0, 255, WIDTH).astype(np.uint8), (HEIGHT, 1))
    assert found_in(ramp, ramp, SEARCH) is None


@settings(max_examples=150, deadline=None)
@given(
    shape=st.tuples(st.integers(1, 120), st.integers(1, 160)), channels=st.sampled_from([(), (3,)]),
    dtype=st.sampled_from([np.uint8, np.uint16]), kind=st.sampled_from(['noise', 'same', 'constant', 'blocks', 'dot']),
    low=st.integers(-1024, 1024), count=st.integers(1, 1024), seed=st.integers(0, 9))
def test_nothing_is_raised_for_any_images(shape, channels, dtype, kind, low, count, seed):
    left, right = (noise(*shape, *channels, dtype=dtype, seed=seed + side) for side in (0, 1))
    if kind == 'same':
        right = left
    elif kind == 'blocks':
        left = right = left // dtype(np.iinfo(dtype).max // 2) * dtype(100)
    elif kind in ('constant', 'dot'):
        left, right = np.full_like(left, 7), np.full_like(right, 7)
        if kind == 'dot':
            left[shape[0] // 2, shape[1] // 2] = np.iinfo(dtype).max
    found = found_in(left, right, (low, low + count - 1))
    assert found is None or (np.isfinite(found[:2]).all() and found.features >= 20)


def test_views_and_very_long_images():
    left, _ = rendered(height=150, width=200)
    assert abs(found_in(left[:, ::-1], left[:, ::-1], SEARCH).median) < 0.01
    long = noise(60, 40000)
    assert abs(found_in(long, long, (0, 3)).median) < 0.01


# The pool and the line


@pytest.fixture
def measured(monkeypatch):
    """Median, 90th percentile of the absolute offsets, and number of the points to be found next; None when the list is
    at its end."""
    results = []
    monkeypatch.setattr(module, 'row_points', lambda *_: points(*results.pop(0)) if results else None)
    return results


def points(median, p90, number):
    dy = np.full(number, median, float)
    dy[:number // 4] = p90
    return RowPoints(np.arange(number, dtype=float), np.zeros(number), dy)


IMAGE = np.zeros((48, 64), np.uint8)


def look(check, times):
    for now in times:
        check.look(IMAGE, IMAGE, SEARCH, now)


def test_figures_are_those_of_the_points():
    assert row_offsets(points(-1.0, 3.0, 40)) == RowOffsets(-1.0, 3.0, 40)


def test_a_pair_in_five_seconds_is_due(measured):
    check = RectificationCheck()
    assert check.is_due(0)
    measured.extend([(0.1, 0.2, 50)] * 3)
    look(check, [100])
    assert not check.is_due(104.9) and check.is_due(105)
    look(check, [105, 110])
    assert check.values() == {'vertical offset (px)': '0.10', 'vertical offset p90 (px)': '0.20', 'features': '150'}
    assert check.line(112) == ''


def test_the_line_comes_with_the_third_result_and_says_what_to_do(measured):
    check = RectificationCheck(period=1.0)
    measured.extend((offset, 2.0, 40) for offset in (-1.25, -9.0, -1.0))
    lines = []
    for now in range(3):
        look(check, [now])
        lines.append(check.line(now))
    assert lines == ['', '', (
        'rows do not correspond: features are 1.25 px higher in the right image in the median (0.5 is allowed), 90 % '
        'of them at most 2.00 px off (1.5 is allowed; 120 features of 3 pairs): check that the images are rectified '
        '(if they are raw: `input: raw`), or calibrate the cameras anew')]


@pytest.mark.parametrize(('median', 'p90', 'said'), [
    (0.5, 1.5, False), (-0.5, 0.6, False), (0.51, 0.6, True), (-0.51, 0.6, True), (0.0, 1.51, True)])
def test_either_bound_is_enough(measured, median, p90, said):
    check = RectificationCheck(period=1.0)
    measured.extend([(median, p90, 40)] * 3)
    look(check, range(3))
    assert bool(check.line(2)) == said


def test_what_is_aligned_is_wrong_no_more(measured):
    check = RectificationCheck(period=1.0)
    measured.extend([(2.0, 2.0, 40)] * 3)
    look(check, range(3))
    rows = RowAlignment((1.9, 0, 0, 0, 0, 0), 64, 48)
    assert check.line(2) and not check.line(2, rows)
    assert check.values(rows)['vertical offset (px)'] == '0.10'
    assert check.line(2, RowAlignment((1.0, 0, 0, 0, 0, 0), 64, 48))


def test_one_wrong_result_changes_nothing_and_old_ones_go(measured):
    check = RectificationCheck(period=1.0)
    measured.extend([(0.0, 0.3, 40)] * 4 + [(5.0, 9.0, 40)] * 3)
    said = []
    for now in range(7):
        look(check, [now])
        said.append(bool(check.line(now)))
    assert said == [False] * 6 + [True]


def test_pairs_that_say_nothing_push_old_results_out(measured):
    check = RectificationCheck(period=1.0)
    measured.extend([(5.0, 5.0, 40)] * 3)
    look(check, range(5))
    assert check.line(4) and check.values()
    look(check, [5])
    assert not check.line(5) and check.values()['features'] == '80'
    look(check, range(6, 8))
    assert not check.line(7) and check.values() == {}


def test_what_was_measured_long_ago_is_no_longer_told(measured):
    check = RectificationCheck(period=1.0)
    measured.extend([(5.0, 5.0, 40)] * 3)
    look(check, range(3))
    assert check.line(5) and not check.line(7)


def test_a_turned_camera_is_told():
    check = RectificationCheck(period=0.0)
    pair = rendered(turn=1.5)
    for now in range(3):
        check.look(*pair, SEARCH, now)
    assert check.line(2).startswith('rows do not correspond: features are 0.')


# The real sequence


def test_the_real_sequence_is_rectified():
    folder = Path(os.environ.get('SVDM_DATA', 'unset')) / 'kitti_odometry_seq1'
    if not folder.is_dir():
        pytest.skip('SVDM_DATA names no folder with kitti_odometry_seq1')
    check = RectificationCheck(period=0.0)
    for index in range(0, 51, 5):
        left, right = (cv2.imread(str(folder / side / f'{index:06d}.png'), cv2.IMREAD_GRAYSCALE)
                       for side in ('left', 'right'))
        found = found_in(left, right, SEARCH)
        assert abs(found.median) < 0.5 and found.p90 < 1.5 and found.features >= 50
        check.look(left, right, SEARCH, index)
        assert check.line(index) == ''
        lowered = np.roll(right, 2, axis=0)
        assert found_in(left, lowered, SEARCH).median == pytest.approx(found.median + 2, abs=0.15)
