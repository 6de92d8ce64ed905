"""Rectification by camera_info against rendered images, against OpenCV's equations, and what is refused."""
import copy
import functools
import math
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from planes import camera_info, raw_position, render

from svdm_core import MatcherParameters, StereoMatcher
from svdm_ros.calibration.rectification import Rectification, RectificationCache, unrectified_line

SIZE, F, BASELINE = (752, 480), 435.0, 0.11
EUROC = [-0.28, 0.07, 0.0002, 1e-5]
FISHEYE = [-0.01, 0.02, -0.015, 0.004]
RATIONAL = [0.4, -0.2, 0.001, -0.0005, 0.03, 0.6, -0.15, 0.02, 0.002, -0.001, 0.0015, 0.0007, 0.01, -0.02]


def camera(side, model='plumb_bob', d=EUROC, **fields):
    """A camera like those of EuRoC, turned a little; P has unequal principal points."""
    left = side == 'left'
    k = [458.0, 457.0, 367.0, 248.0] if left else [457.0, 456.0, 379.0, 255.0]
    if model == 'equidistant':
        k[:2] = [380.0, 381.0]
    turn = (0.012, -0.025, 0.008) if left else (-0.01, 0.02, -0.015)
    p = (F, 370.0, 245.0, 0.0) if left else (F, 365.0, 245.0, -F * BASELINE)
    return camera_info(SIZE, model, d, k, turn, p, **fields)


def part(x=0, y=0, width=0, height=0):
    return SimpleNamespace(x_offset=x, y_offset=y, width=width, height=height, do_rectify=False)


@functools.cache
def raw_image(side, model='plumb_bob'):
    return render(camera(side, model, FISHEYE if model == 'equidistant' else EUROC), raw=True)[0]


def inside(info, margin=1.0):
    """Which rectified pixels are taken from the raw image, naively."""
    u, v = np.meshgrid(np.arange(info.width, dtype=float), np.arange(info.height, dtype=float))
    x, y = raw_position(info, u, v)
    return (x > margin) & (x < info.width - 1 - margin) & (y > margin) & (y < info.height - 1 - margin)


@pytest.mark.parametrize(('model', 'd'), [('plumb_bob', EUROC), ('equidistant', FISHEYE)])
def test_a_pair_of_raw_images_gives_the_true_depth(model, d):
    infos = camera('left', model, d), camera('right', model, d)
    rectified, depths, raw = [], [], []
    for side, info in zip(('left', 'right'), infos, strict=True):
        image = raw_image(side, model)
        expected, depth = render(info, raw=False)
        found = Rectification.of(info, *SIZE)(image)
        difference = cv2.absdiff(found, expected)[inside(info)]
        assert inside(info).mean() > 0.99
        assert difference.mean() < 0.6
        assert np.quantile(difference, 0.99) <= 4, 'all but the edge between the two planes'
        rectified.append(found)
        depths.append(depth)
        raw.append(image)
    truth = F * BASELINE / depths[0]  # px, without the principal points
    both = inside(infos[0], 12) & (np.arange(SIZE[0]) - truth - 5 > 20)
    matcher = StereoMatcher(MatcherParameters(min_disparity=46))
    disparity = matcher.compute(*rectified).disparity - (370.0 - 365.0)
    right = both & (np.abs(disparity - truth) < 1)
    error = np.abs(F * BASELINE / disparity[both] - depths[0][both]) / depths[0][both]
    assert right[both].mean() > 0.999
    assert np.mean(error < 0.01) > 0.998, 'the rest is the edge'
    assert np.median(error) < 0.002
    without = matcher.compute(*raw).disparity - (370.0 - 365.0)
    assert np.mean(np.abs(without - truth)[both] < 1) < 0.1, 'the raw pair shows that rectifying matters'


@pytest.mark.parametrize(('model', 'd'), [
    ('plumb_bob', []), ('', []), ('plumb_bob', EUROC), ('plumb_bob', [*EUROC, 0.03]),
    ('rational_polynomial', RATIONAL[:8]), ('rational_polynomial', RATIONAL[:12]), ('rational_polynomial', RATIONAL),
    ('equidistant', FISHEYE)])
def test_the_maps_are_those_of_the_equations(model, d):
    info = camera('right', model, d)
    whole, fraction = Rectification.of(info, *SIZE).maps
    assert (whole.dtype, fraction.dtype) == (np.int16, np.uint16)
    generator = np.random.default_rng(3)
    u, v = (generator.integers(0, side, 200) for side in SIZE)
    x, y = raw_position(info, u.astype(float), v.astype(float))
    found_x = whole[v, u, 0] + (fraction[v, u] & 31) / 32
    found_y = whole[v, u, 1] + (fraction[v, u] >> 5) / 32
    shown = (x > -1) & (x < SIZE[0]) & (y > -1) & (y < SIZE[1])
    assert shown.sum() > 100
    np.testing.assert_allclose(found_x[shown], x[shown], atol=1 / 64 + 1e-4)
    np.testing.assert_allclose(found_y[shown], y[shown], atol=1 / 64 + 1e-4)


def test_four_coefficients_are_five_with_k3_of_0():
    four, five = (Rectification.of(camera('left', d=d), *SIZE) for d in (EUROC, [*EUROC, 0.0]))
    for found, expected in zip(four.maps, five.maps, strict=True):
        np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize(('model', 'd', 'focal_length'), [
    ('plumb_bob', EUROC, 300.0), ('plumb_bob', [0.3, 0.9, 0, 0, 6.0], 60.0), ('equidistant', FISHEYE, 30.0)])
def test_outside_of_the_raw_image_is_black_however_far(model, d, focal_length):
    """60 px of focal length reach coordinates beyond 2**31 px: cut to 16 bits they would come back in."""
    info = camera('left', model, d)
    info.p[0] = info.p[5] = focal_length
    rectified = Rectification.of(info, *SIZE)(np.full(SIZE[::-1], 200, np.uint8))
    u, v = np.meshgrid(*(np.arange(side, dtype=float) for side in SIZE))
    x, y = raw_position(info, u, v)
    outside = (x < -1.1) | (x > SIZE[0] + 0.1) | (y < -1.1) | (y > SIZE[1] + 0.1)
    assert 0.05 < outside.mean() < 1
    assert (rectified[outside] == 0).all()
    assert (rectified[inside(info, 0)] == 200).all()


@pytest.mark.parametrize(('dtype', 'channels'), [(np.uint8, 3), (np.uint16, 1), (np.uint16, 3)])
def test_colour_and_16_bits_are_rectified_as_grey(dtype, channels):
    info = camera('left')
    rectification = Rectification.of(info, *SIZE)
    grey = raw_image('left')
    expected = rectification(grey).astype(float)
    scale = 257 if dtype == np.uint16 else 1
    image = np.repeat((grey.astype(dtype) * scale)[:, :, None], channels, 2)[:, :, ::-1]
    found = rectification(image[:, :, 0] if channels == 1 else image)
    assert found.dtype == dtype and found.shape == (SIZE[1], SIZE[0], 3)[:2 if channels == 1 else 3]
    for channel in np.atleast_3d(found).transpose(2, 0, 1):
        assert np.abs(channel / scale - expected).max() <= 1


# binning and roi


def test_a_region_of_interest_gives_that_part_of_the_whole():
    info = camera('left')
    image = raw_image('left')
    x, y, width, height = 101, 57, 400, 302
    info_of_part = camera('left', roi=part(x, y, width, height))
    found = Rectification.of(info_of_part, width, height)(image[y:y + height, x:x + width])
    whole = Rectification.of(info, *SIZE)(image)[y:y + height, x:x + width]
    u, v = np.meshgrid(np.arange(width) + float(x), np.arange(height) + float(y))
    raw_x, raw_y = raw_position(info, u, v)
    kept = (raw_x > x + 1) & (raw_x < x + width - 2) & (raw_y > y + 1) & (raw_y < y + height - 2)
    assert kept.mean() > 0.85
    assert cv2.absdiff(found, whole)[kept].max() <= 2


@pytest.mark.parametrize('binning', [(2, 2), (2, 1), (1, 2), (4, 4), (3, 3)])
@pytest.mark.parametrize('roi', [part(), part(40, 24, 480, 360)])
def test_binning_gives_the_whole_shrunk(binning, roi):
    across, down = binning
    info = camera('left')
    image = cv2.GaussianBlur(raw_image('left'), (0, 0), 2 * max(binning))
    rows = slice(roi.y_offset, roi.y_offset + (roi.height or SIZE[1]))
    columns = slice(roi.x_offset, roi.x_offset + (roi.width or SIZE[0]))
    height, width = (rows.stop - rows.start) // down, (columns.stop - columns.start) // across
    binned = image[rows, columns][:height * down, :width * across].reshape(height, down, width, across).mean((1, 3))
    info_of_binned = camera('left', roi=roi, binning_x=across, binning_y=down)
    found = Rectification.of(info_of_binned, width, height)(np.rint(binned).astype(np.uint8))
    whole = Rectification.of(info, *SIZE)(image)[rows, columns]
    expected = whole[:height * down, :width * across].reshape(height, down, width, across).mean((1, 3))
    margin = 40 // min(binning)
    difference = np.abs(found - expected)[margin:-margin, margin:-margin]
    assert difference.mean() < 0.7 and np.quantile(difference, 0.99) < 3


@pytest.mark.parametrize('binning', [(2, 2), (2, 1), (1, 4)])
def test_the_maps_of_binned_images_are_every_nth_of_the_whole(binning):
    across, down = binning
    info = camera('left', roi=part(8, 16, 640, 400))
    whole = Rectification.of(info, 640, 400).maps
    binned = camera('left', roi=info.roi, binning_x=across, binning_y=down)
    found = Rectification.of(binned, 640 // across, 400 // down).maps
    for axis, shift, step, side in ((0, 0, across, 640), (1, 5, down, 400)):
        expected, got = ((maps[0][:, :, axis] + (maps[1] >> shift & 31) / 32) for maps in (whole, found))
        expected = expected[::down, ::across]
        within = (expected > 0) & (expected < side)
        assert within.mean() > 0.9
        np.testing.assert_allclose(got[within], expected[within] / step, atol=1 / 32)


def test_binning_of_0_is_binning_of_1():
    maps = [Rectification.of(camera('left', binning_x=binning, binning_y=binning), *SIZE).maps for binning in (0, 1)]
    np.testing.assert_array_equal(maps[0][0], maps[1][0])


def test_a_camera_info_without_a_size_fits_the_image():
    found = Rectification.of(camera('left', width=0, height=0), *SIZE).maps
    np.testing.assert_array_equal(found[0], Rectification.of(camera('left'), *SIZE).maps[0])


# The cache


def changed(name, index, value):
    def change(info):
        getattr(info, name)[index] = value
    return change


CHANGES = {
    'k': changed('k', 2, 368.0), 'd': changed('d', 0, -0.27), 'p': changed('p', 0, 430.0),
    'd longer': lambda info: info.d.append(0.01),
    'model': lambda info: setattr(info, 'distortion_model', 'equidistant'),
    'r': lambda info: setattr(info, 'r', np.eye(3).ravel()),
    'roi': lambda info: setattr(info, 'roi', part(0, 0, *SIZE[:1], SIZE[1])),
}


@pytest.mark.parametrize('name', CHANGES)
def test_the_maps_are_kept_until_the_calibration_changes(name):
    info, cache = camera('left'), RectificationCache()
    first = cache.of(info, *SIZE)
    same = copy.deepcopy(info)
    same.k, same.header = np.array(same.k), 'another stamp'
    assert cache.of(same, *SIZE) is first, 'other objects, the same values'
    CHANGES[name](info)  # in place: the object is that of the first call
    second = cache.of(info, *SIZE)
    equal = all(np.array_equal(a, b) for a, b in zip(first.maps, second.maps, strict=True))
    assert equal == (name == 'roi')
    np.testing.assert_array_equal(second.maps[0], Rectification.of(info, *SIZE).maps[0])
    assert cache.of(info, *SIZE) is second


def test_a_bad_calibration_leaves_the_cache_as_it_was():
    info, cache = camera('left'), RectificationCache()
    first = cache.of(info, *SIZE)
    with pytest.raises(ValueError):
        cache.of(camera('left', d=[math.nan] * 4), *SIZE)
    assert cache.of(info, *SIZE) is first


# What is refused


@pytest.mark.parametrize(('change', 'told'), [
    (changed('k', 0, 0.0), r'not calibrated: K\[0\] is 0, it must be positive: calibrate'),
    (changed('k', 4, -3.0), r'K\[4\] is -3'),
    (changed('k', 1, 5.0), r'K\[1\] = 5, it must be 0'),
    (changed('k', 8, 0.0), r'K\[8\] = 0, it must be 1'),
    (changed('k', 2, math.nan), r'K\[2\] = nan'),
    (changed('d', 3, math.inf), r'D\[3\] = inf'),
    (changed('p', 0, 0.0), r'not calibrated: P\[0\] is 0'),
    (changed('p', 5, -1.0), r'P\[5\] is -1'),
    (changed('p', 4, 9.0), r'P\[4\] = 9, it must be 0'),
    (changed('p', 3, math.nan), r'P\[3\] = nan'),
    (changed('r', 0, 0.5), r'R = \[0.5, .*must be a rotation'),
    (lambda info: setattr(info, 'r', np.zeros(9)), r'R = \[0, .*must be a rotation'),
    (lambda info: setattr(info, 'r', np.diag([1.0, 1.0, -1.0]).ravel()), 'must be a rotation'),
    (lambda info: setattr(info, 'distortion_model', 'thin\nlens' * 99),
     r"distortion_model 'thin\\nlens.*\.\.\. \(891 c"),
    (lambda info: setattr(info, 'd', [0.1] * 8), '8 numbers in D, plumb_bob has 0 or 4 or 5'),
    (lambda info: setattr(info, 'distortion_model', 'rational_polynomial'),
     '4 numbers in D, rational_polynomial has 8'),
    (lambda info: setattr(info, 'binning_x', 2), '376x480 px, after roi and binning, the image has 752x480'),
    (lambda info: setattr(info, 'roi', part(0, 0, 640, 480)), '640x480 px, after roi and binning'),
    (lambda info: setattr(info, 'roi', part(10, 0, 752, 480)), r'roi of 752x480 px at \(10, 0\), it must lie within'),
    (lambda info: setattr(info, 'width', 1504), '1504x480 px'),
])
def test_what_is_no_calibration_of_the_image_is_refused_in_one_line(change, told):
    info = camera('left')
    change(info)
    with pytest.raises(ValueError, match=told) as refusal:
        Rectification.of(info, *SIZE)
    line = str(refusal.value)
    assert line.isprintable() and len(line) < 500


def test_an_image_of_another_size_is_refused():
    with pytest.raises(ValueError, match='for images of 752x480 px, the image has 752x479'):
        Rectification.of(camera('left'), *SIZE)(np.zeros((479, 752), np.uint8))
    with pytest.raises(ValueError, match='the image has 0x5 px'):
        Rectification.of(camera('left', width=0, height=0), 0, 5)


# Raw images where rectified ones are expected


@pytest.mark.parametrize('topic', ['/left/image_raw', '/cam0/unrectified/x', '/direct/left/image', '/left/raw'])
def test_raw_images_are_told(topic):
    line = unrectified_line(camera('left'), topic)
    assert line.startswith(f'{topic} looks raw') and line.isprintable()
    assert 'D is [-0.28, 0.07, 0.0002, 1e-05]' in line and 'R is not the identity' in line
    assert 'input: raw' in line and 'image_rect' in line


@pytest.mark.parametrize('topic', ['/left/image_rect', '/left/image_rect_color', '/rectified/left', '/left/Rect/x'])
def test_rectified_topics_have_the_camera_info_of_the_raw_images(topic):
    assert unrectified_line(camera('left'), topic) == ''


def test_only_what_is_there_to_rectify_is_told():
    flat = camera('left', d=[0.0] * 5)
    assert unrectified_line(flat, 'image').count('R is not') == 1 and 'D is' not in unrectified_line(flat, 'image')
    turned = camera('left')
    turned.r = np.eye(3).ravel() + 1e-9
    assert 'R is' not in unrectified_line(turned, 'image') and 'D is' in unrectified_line(turned, 'image')
    for r in (np.eye(3), np.zeros((3, 3))):  # zeros: left out by the driver
        flat.r = r.ravel()
        assert unrectified_line(flat, 'image') == ''
