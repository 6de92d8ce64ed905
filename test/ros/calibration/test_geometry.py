"""Focal length, baseline and principal offset from camera_info: depth must not depend on scale, binning or roi."""
import math

import pytest
from hypothesis import given
from hypothesis import strategies as st
from sensor_msgs.msg import CameraInfo, RegionOfInterest

from svdm_ros.calibration.geometry import stereo_geometry

WIDTH, HEIGHT = 1280, 960
FOCAL_LENGTH, BASELINE, CX_LEFT, CX_RIGHT = 1000.0, 0.12, 640.0, 625.0


def camera_info(side, f=FOCAL_LENGTH, cx=None, tx=None, width=WIDTH, height=HEIGHT, **fields):
    if cx is None:
        cx = CX_LEFT if side == 'left' else CX_RIGHT
    if tx is None:
        tx = 0.0 if side == 'left' else -f * BASELINE
    p = [f, 0.0, cx, tx, 0.0, f, height / 2, 0.0, 0.0, 0.0, 1.0, 0.0]
    return CameraInfo(width=width, height=height, p=p, **fields)


def geometry_of(width=WIDTH, height=HEIGHT, baseline=0.0, **fields):
    return stereo_geometry(camera_info('left', **fields), camera_info('right', **fields), width, height, baseline)


def depth(geometry, x_left, x_right):
    disparity = x_left - x_right - geometry.principal_offset
    return geometry.focal_length * geometry.baseline / disparity


def test_the_full_image():
    geometry = geometry_of()
    assert geometry.focal_length == FOCAL_LENGTH
    assert geometry.baseline == pytest.approx(BASELINE)
    assert geometry.principal_offset == CX_LEFT - CX_RIGHT
    assert geometry.problem == ''


@given(divisor=st.sampled_from([1, 2, 4, 5, 8, 16]), x_left=st.floats(300, 900), shift=st.floats(20, 250))
def test_depth_does_not_change_with_the_scale(divisor, x_left, shift):
    scaled = geometry_of(WIDTH // divisor, HEIGHT // divisor)
    full_depth = depth(geometry_of(), x_left, x_left - shift)
    assert depth(scaled, x_left / divisor, (x_left - shift) / divisor) == pytest.approx(full_depth)
    assert scaled.baseline == pytest.approx(BASELINE)
    assert scaled.problem == ''


BINNING = st.sampled_from([0, 1, 2, 4])


@given(binning_x=BINNING, binning_y=BINNING, further=st.sampled_from([1, 2]))
def test_depth_does_not_change_with_binning(binning_x, binning_y, further):
    across, down = max(binning_x, 1) * further, max(binning_y, 1) * further
    geometry = geometry_of(WIDTH // across, HEIGHT // down, binning_x=binning_x, binning_y=binning_y)
    assert geometry.problem == ''
    assert geometry.focal_length == pytest.approx(FOCAL_LENGTH / across)
    assert geometry.baseline == pytest.approx(BASELINE)
    assert depth(geometry, 600 / across, 500 / across) == pytest.approx(depth(geometry_of(), 600, 500))


@given(binning=st.sampled_from([0, 2]), left_offset=st.integers(0, 400), right_offset=st.integers(0, 400))
def test_depth_does_not_change_with_the_region_of_interest(binning, left_offset, right_offset):
    """roi is in unbinned px, and each camera may have its own."""
    across = max(binning, 1)
    infos = [
        camera_info(side, binning_x=binning, binning_y=binning,
                    roi=RegionOfInterest(x_offset=offset, y_offset=7, width=640, height=480))
        for side, offset in (('left', left_offset), ('right', right_offset))
    ]
    geometry = stereo_geometry(*infos, 640 // across, 480 // across)
    assert geometry.problem == ''
    found = depth(geometry, (600 - left_offset) / across, (480 - right_offset) / across)
    assert found == pytest.approx(depth(geometry_of(), 600, 480))


@given(width=st.integers(1, WIDTH))
def test_any_scale_of_an_odd_image_is_taken(width):
    height = max(1, round(500 * width / 741))
    infos = [camera_info(side, width=741, height=500) for side in ('left', 'right')]
    geometry = stereo_geometry(*infos, width, height)
    assert geometry.problem == ''
    assert geometry.focal_length == pytest.approx(FOCAL_LENGTH * width / 741)


def test_a_size_that_is_no_scaled_copy_is_a_problem():
    geometry = geometry_of(640, 300)
    assert (geometry.focal_length, geometry.baseline) == (0, 0)
    assert 'left/camera_info tells of 1280x960 px, the image has 640x300' in geometry.problem


def test_a_camera_info_without_size_is_taken_as_of_the_image():
    infos = [camera_info(side, width=0, height=0) for side in ('left', 'right')]
    assert stereo_geometry(*infos, 640, 480).focal_length == FOCAL_LENGTH


@pytest.mark.parametrize(('left', 'right', 'named'), [
    (None, None, 'no left/camera_info and no right/camera_info'),
    (camera_info('left'), None, 'no right/camera_info'),
    (None, camera_info('right'), 'no left/camera_info'),
])
def test_a_missing_camera_info_is_named(left, right, named):
    geometry = stereo_geometry(left, right, WIDTH, HEIGHT)
    assert (geometry.focal_length, geometry.baseline, geometry.principal_offset) == (0, 0, 0)
    assert geometry.problem.startswith(named + ' received')


@pytest.mark.parametrize(('tx', 'advice'), [(0.0, 'calibrate'), (120.0, 'swapped')])
def test_no_baseline_is_a_problem_but_keeps_the_rest(tx, advice):
    geometry = stereo_geometry(camera_info('left'), camera_info('right', tx=tx), WIDTH, HEIGHT)
    assert (geometry.focal_length, geometry.baseline) == (FOCAL_LENGTH, 0)
    assert f'right/camera_info has no baseline: P[3] is {tx:g}' in geometry.problem
    assert advice in geometry.problem


def test_the_baseline_in_the_left_camera_info_points_to_swapped_topics():
    geometry = stereo_geometry(camera_info('left', tx=-120.0), camera_info('right', tx=0.0), WIDTH, HEIGHT)
    assert 'swapped' in geometry.problem


@pytest.mark.parametrize('tx', [-120.0, 45.0])
def test_a_left_camera_that_is_not_the_origin_is_a_problem_but_keeps_the_rest(tx):
    """The baseline of two cameras out of more is the difference of both."""
    infos = camera_info('left', tx=tx), camera_info('right', tx=tx - FOCAL_LENGTH * BASELINE)
    geometry = stereo_geometry(*infos, WIDTH, HEIGHT)
    assert (geometry.focal_length, geometry.baseline) == (FOCAL_LENGTH, pytest.approx(BASELINE))
    assert geometry.problem.startswith(f'left/camera_info has P[3] = {tx:g}, so the left camera is not the origin')
    assert 'the baseline 0.12 m' in geometry.problem and 'set the parameter baseline' in geometry.problem
    assert stereo_geometry(*infos, WIDTH, HEIGHT, baseline=0.2).problem == ''


def test_a_left_camera_that_is_the_origin_but_for_rounding_is_none():
    assert stereo_geometry(camera_info('left', tx=-1e-7), camera_info('right'), WIDTH, HEIGHT).problem == ''


@pytest.mark.parametrize(('factor', 'told'), [(1.005, False), (0.995, False), (1.02, True), (0.98, True)])
def test_focal_lengths_that_differ_are_a_problem_but_keep_the_rest(factor, told):
    infos = camera_info('left', f=factor * FOCAL_LENGTH), camera_info('right')
    geometry = stereo_geometry(*infos, WIDTH, HEIGHT)
    assert (geometry.focal_length, geometry.baseline) == (FOCAL_LENGTH, pytest.approx(BASELINE))
    expected = f'have focal lengths of {factor * FOCAL_LENGTH:g} and 1000 px: rectify both'
    assert (expected in geometry.problem) is told
    assert bool(geometry.problem) is told


def test_focal_lengths_are_compared_in_px_of_the_images_matched():
    infos = camera_info('left', f=2000.0, width=2 * WIDTH, height=2 * HEIGHT), camera_info('right')
    assert stereo_geometry(*infos, WIDTH, HEIGHT).problem == ''


def test_several_problems_are_all_told():
    infos = camera_info('left', f=2000.0), camera_info('right', tx=0.0)
    problem = stereo_geometry(*infos, WIDTH, HEIGHT).problem
    assert 'has no baseline' in problem
    assert 'focal lengths of 2000 and 1000 px' in problem


@pytest.mark.parametrize('offset', [10 * WIDTH, -10 * WIDTH])
def test_principal_points_may_be_ten_image_widths_apart(offset):
    geometry = stereo_geometry(camera_info('left', cx=offset), camera_info('right', cx=0.0), WIDTH, HEIGHT)
    assert (geometry.principal_offset, geometry.problem) == (offset, '')


@pytest.mark.parametrize('offset', [1e7, -12801])
def test_principal_points_further_apart_are_a_problem(offset):
    """float32 no longer tells min_disparity from the invalid min_disparity - 1 when both are shifted by 1e8."""
    geometry = stereo_geometry(camera_info('left', cx=offset), camera_info('right', cx=0.0), WIDTH, HEIGHT)
    assert (geometry.focal_length, geometry.baseline, geometry.principal_offset) == (0, 0, 0)
    assert f'principal points {offset:g} px apart in images 1280 px wide' in geometry.problem


@pytest.mark.parametrize('tx', [0.0, 120.0, None])
def test_the_baseline_parameter_wins(tx):
    geometry = stereo_geometry(camera_info('left'), camera_info('right', tx=tx), WIDTH, HEIGHT, baseline=0.5)
    assert (geometry.baseline, geometry.problem) == (0.5, '')


@pytest.mark.parametrize('entry', [0, 2, 3])
@pytest.mark.parametrize('value', [math.nan, math.inf, -math.inf, 1e300])
@pytest.mark.parametrize('side', ['left', 'right'])
def test_an_impossible_p_matrix_is_a_problem(side, entry, value):
    infos = {name: camera_info(name) for name in ('left', 'right')}
    infos[side].p[entry] = value
    geometry = stereo_geometry(infos['left'], infos['right'], WIDTH, HEIGHT)
    assert geometry.problem.startswith(f'{side}/camera_info has a P matrix with')
    assert (geometry.focal_length, geometry.baseline, geometry.principal_offset) == (0, 0, 0)


@pytest.mark.parametrize('focal_length', [0.0, -500.0, 1e-300])
def test_an_uncalibrated_camera_is_a_problem(focal_length):
    geometry = geometry_of(f=focal_length)
    assert 'left/camera_info is not calibrated' in geometry.problem
    assert geometry.focal_length == 0


@pytest.mark.parametrize(('entry', 'value', 'told'), [
    (1, 52.43, 'P[1] = 52.43, it must be 0'), (5, 1020.0, 'P[0] = 1000 and P[5] = 1020, they must be the same'),
    (6, 475.0, 'cy of'), (1, 1e-9, ''), (5, 1002.0, ''), (6, 480.4, '')])
@pytest.mark.parametrize('side', ['left', 'right'])
def test_a_p_matrix_of_no_rectified_pair_is_told(side, entry, value, told):
    infos = {name: camera_info(name) for name in ('left', 'right')}
    infos[side].p[entry] = value
    geometry = stereo_geometry(infos['left'], infos['right'], WIDTH, HEIGHT)
    assert told in geometry.problem and bool(geometry.problem) is bool(told)
    assert geometry.baseline == pytest.approx(BASELINE)


@pytest.mark.parametrize(('metres', 'told'), [(7.5, ''), (12.0, 'cm or mm'), (120.0, 'cm or mm')])
def test_a_baseline_in_cm_or_mm_is_told(metres, told):
    geometry = stereo_geometry(camera_info('left'), camera_info('right', tx=-FOCAL_LENGTH * metres), WIDTH, HEIGHT)
    assert geometry.baseline == pytest.approx(metres)
    assert told in geometry.problem and bool(geometry.problem) is bool(told)


@given(x=st.integers(0, 700), y=st.integers(0, 500), factor=st.integers(1, 4), u=st.floats(300, 900),
       v=st.floats(100, 800), shift=st.floats(5, 250))
def test_a_point_is_the_same_in_any_part_of_the_image_and_at_any_scale(x, y, factor, u, v, shift):
    def point(geometry, u, v, disparity):
        z = geometry.focal_length * geometry.baseline / (disparity - geometry.principal_offset)
        return (u - geometry.cx) * z / geometry.focal_length, (v - geometry.cy) * z / geometry.focal_length_y, z

    whole, part = geometry_of(), geometry_of().cropped(x, y).shrunk(factor)
    shift += abs(whole.principal_offset)
    small = ((u - x + 0.5) / factor - 0.5, (v - y + 0.5) / factor - 0.5)
    assert point(part, *small, shift / factor) == pytest.approx(point(whole, u, v, shift), rel=1e-6, abs=1e-6)
