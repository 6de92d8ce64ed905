"""Calibration files of KITTI, EuRoC, Middlebury and ROS, against points projected by their own equations."""
import cv2
import numpy as np
import pytest
import yaml
from calibrations import (
    EUROC_BASELINE,
    EUROC_SIZE,
    KITTI_MATRICES,
    MIDDLEBURY,
    euroc_documents,
    write_euroc,
    write_kitti,
    write_ros,
)

from svdm_ros.calibration.calibration_files import read_calibration


def geometry(calibration):
    return calibration.focal_length, calibration.baseline, calibration.principal_offset


@pytest.mark.parametrize('kind', ['odometry', 'raw', 'lines'])
@pytest.mark.parametrize('colour', [False, True])
def test_kitti_tells_the_cameras_of_either_pair_from_its_left_one(tmp_path, kind, colour):
    calibration = read_calibration([write_kitti(tmp_path, kind)], colour)
    left, right = KITTI_MATRICES[2:] if colour else KITTI_MATRICES[:2]
    focal_length = left[0][0]
    assert geometry(calibration) == pytest.approx((focal_length, (left[0][3] - right[0][3]) / focal_length, 0.0))
    assert (calibration.left.p[:, 3] == 0).all()
    assert calibration.left.size == ((1242, 375) if kind == 'raw' else None)
    assert calibration.is_rectified


def test_kitti_with_two_bare_lines_is_left_and_right(tmp_path):
    path = tmp_path / 'calib.txt'
    path.write_text('\n'.join(' '.join(map(str, np.ravel(matrix))) for matrix in KITTI_MATRICES[:2]))
    assert read_calibration([path], False).baseline == pytest.approx(0.5, abs=0.1)


def test_middlebury_is_told_in_metres_and_with_its_principal_points(tmp_path):
    path = tmp_path / 'calib.txt'
    path.write_text(MIDDLEBURY)
    calibration = read_calibration([path], True)
    assert geometry(calibration) == pytest.approx((1000.0, 0.2, -50.0))  # doffs = cx1 - cx0
    assert calibration.left.size == (800, 600)


def test_scaling_leaves_the_depth_as_it_is(tmp_path):
    path = tmp_path / 'calib.txt'
    path.write_text(MIDDLEBURY)
    whole = read_calibration([path], True)
    half = whole.scaled((400, 300))
    assert geometry(half) == pytest.approx((500.0, 0.2, -25.0))
    np.testing.assert_allclose(half.left.k, np.diag([0.5, 0.5, 1]) @ whole.left.k)
    with pytest.raises(ValueError, match='calibration is of 800x600 px, the images have 400x280'):
        whole.scaled((400, 280))


def seen(calibration, side, points):
    """Where rectified images have `points` (N, 3) of the raw left camera, px (N, 2); and their z when rectified."""
    document = dict(zip(('left', 'right'), euroc_documents(), strict=True))[side]
    body_from_left = np.reshape(euroc_documents()[0]['T_BS']['data'], (4, 4))
    own = np.linalg.inv(np.reshape(document['T_BS']['data'], (4, 4))) @ body_from_left
    f_x, f_y, c_x, c_y = document['intrinsics']
    k = np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]])
    d = np.array(document['distortion_coefficients'])
    raw = cv2.projectPoints(points, cv2.Rodrigues(own[:3, :3])[0], own[:3, 3], k, d)[0]
    camera = calibration.camera(side)
    return cv2.undistortPoints(raw, k, d, R=camera.r, P=camera.p)[:, 0], (points @ camera.r.T)[:, 2]


@pytest.mark.parametrize('write', [write_euroc, write_ros])
def test_rectified_points_lie_in_the_same_row_and_triangulate(tmp_path, write):
    calibration = read_calibration(write(tmp_path), False)
    assert not calibration.is_rectified
    assert calibration.left.size == EUROC_SIZE
    assert calibration.baseline == pytest.approx(EUROC_BASELINE, rel=1e-6)
    points = np.random.default_rng(3).uniform((-1, -0.6, 2), (1, 0.6, 6), (50, 3))
    (left, depth), (right, _) = (seen(calibration, side, points) for side in ('left', 'right'))
    np.testing.assert_allclose(left[:, 1], right[:, 1], atol=0.01)
    disparity = left[:, 0] - right[:, 0] - calibration.principal_offset
    np.testing.assert_allclose(calibration.focal_length * calibration.baseline / disparity, depth, rtol=1e-3)


def test_euroc_finds_the_right_camera_beside_the_left_one(tmp_path):
    left, right = write_euroc(tmp_path)
    assert read_calibration([left], False).baseline == read_calibration([left, right], False).baseline
    right.unlink()
    with pytest.raises(ValueError, match='of one camera: give --calib twice'):
        read_calibration([left], False)


def test_swapped_cameras_are_told(tmp_path):
    with pytest.raises(ValueError, match=r'baseline is -0\.11 m, it must be positive: left and right look swapped'):
        read_calibration(write_euroc(tmp_path)[::-1], False)


@pytest.mark.parametrize(('change', 'told'), [
    (('baseline=200', 'baseline='), "baseline is '', it must be a number"),
    (('baseline=200', ''), 'baseline is missing'),
    (('cam1=[1000 0 450;', 'cam1=[1000 450;'), 'cam1 has 8 numbers, a camera matrix has 9'),
    (('doffs=50', 'doffs=40'), 'doffs is 40, the principal points of cam0 and cam1 are 50 px apart'),
    (('cam0', 'camera'), 'none of the calibrations known'),
])
def test_what_is_wrong_with_a_middlebury_file_is_told(tmp_path, change, told):
    path = tmp_path / 'calib.txt'
    path.write_text(MIDDLEBURY.replace(*change))
    with pytest.raises(ValueError, match=rf'^{path}: .*{told}'):
        read_calibration([path], False)


@pytest.mark.parametrize(('change', 'told'), [
    ({'intrinsics': None}, 'intrinsics is missing'),
    ({'distortion_model': 'equidistant'}, "distortion_model of the right camera is 'equidistant', it must be radial"),
    ({'resolution': [640, 480]}, 'different sizes: left 752x480, right 640x480'),
    ({'resolution': 'VGA'}, "resolution of the right camera is 'VGA', it must be"),
    ({'T_BS': {'data': [1, 2]}}, 'T_BS of the right camera must be 16 numbers'),
    ({'intrinsics': [float('nan')] * 4}, 'intrinsics of the right camera must be 4 numbers'),
])
def test_what_is_wrong_with_a_euroc_file_is_told(tmp_path, change, told):
    left, right = write_euroc(tmp_path)
    document = euroc_documents()[1] | change
    right.write_text(yaml.safe_dump({name: value for name, value in document.items() if value is not None}))
    with pytest.raises(ValueError, match=told):
        read_calibration([left, right], False)


@pytest.mark.parametrize(('text', 'told'), [
    ('P0: 1 2 3', 'P1 is missing|P0 has 3 numbers'),
    ('', 'none of the calibrations known'),
    ('P2: 1 2 3', 'P0 is missing'),
])
def test_what_is_wrong_with_a_kitti_file_is_told(tmp_path, text, told):
    path = tmp_path / 'calib.txt'
    path.write_text(text)
    with pytest.raises(ValueError, match=told):
        read_calibration([path], False)


def test_files_that_are_none_are_told(tmp_path):
    broken = tmp_path / 'sensor.yaml'
    broken.write_text('a: [1')
    with pytest.raises(ValueError, match='no YAML'):
        read_calibration([broken], False)
    with pytest.raises(ValueError, match='there is no such file'):
        read_calibration([tmp_path / 'calib.txt'], False)
    with pytest.raises(ValueError, match='given 3 times'):
        read_calibration([broken] * 3, False)
