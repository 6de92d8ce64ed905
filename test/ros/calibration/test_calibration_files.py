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


# Of more tools


SIZE = (752, 480)
CAMERA = [720.0, 0, 386, 0, 720, 217, 0, 0, 1]
LENS = [0.05, 0.18, -1e-3, 1e-3, -0.7, 0.02, 0.03, 0.01, 1e-3, 2e-3, 3e-3, 4e-3, 0.01, 0.02]


def ros_text(shift, count=5, model='plumb_bob', tag='', head=''):
    """A camera as ROS tools write it, or OpenCV with the names of ROS."""
    def matrix(name, rows, data):
        size = f'   rows: {rows}\n   cols: {len(data) // rows}\n   dt: d\n'
        return f'{name}:{tag}\n{size}   data: {list(map(float, data))}\n'
    return (f'{head}image_width: {SIZE[0]}\nimage_height: {SIZE[1]}\ncamera_name: any\n'
            + matrix('camera_matrix', 3, CAMERA)
            + (f'distortion_model: {model}\n' if model else '') + matrix('distortion_coefficients', 1, LENS[:count])
            + matrix('rectification_matrix', 3, np.eye(3).ravel())
            + matrix('projection_matrix', 3, [721, 0, 387, shift, 0, 721, 222, 0, 0, 0, 1, 0]))


def written_pair(folder, **how):
    files = [folder / 'left.yaml', folder / 'right.yaml']
    for file, shift in zip(files, (0, -43.8), strict=True):
        file.write_text(ros_text(shift, **how))
    return files


@pytest.mark.parametrize('how', [
    {'tag': ' !!opencv-matrix', 'head': '%YAML:1.0\n---\n'}, {'count': 4}, {'count': 4, 'model': 'radtan'},
    {'model': 'radial-tangential'}, {'model': None}, {'model': None, 'count': 12},
    *({'count': count, 'model': 'rational_polynomial'} for count in (8, 12, 14))], ids=str)
def test_ros_calibrations_of_any_tool_are_read(tmp_path, how):
    calibration = read_calibration(written_pair(tmp_path, **how), False)
    assert geometry(calibration) == pytest.approx((721, 43.8 / 721, 0))
    count = how.get('count', 5)
    expected = [*LENS[:4], 0.0] if count == 4 else LENS[:count]
    assert calibration.left.d.tolist() == calibration.right.d.tolist() == expected


@pytest.mark.parametrize(('how', 'told'), [
    ({'count': 5, 'model': 'rational_polynomial'},
     'distortion_coefficients of the left camera must be 8 or 12 or 14 numbers (rational_polynomial), it has 5'),
    ({'count': 8}, 'must be 4 or 5 numbers (plumb_bob), it has 8'),
    ({'count': 3, 'model': None}, 'must be 4 or 5 or 8 or 12 or 14 numbers, it has 3'),
    ({'count': 4, 'model': 'equidistant'}, "distortion_model of the left camera is 'equidistant'"),
    ({'model': '[1, 2]'}, 'distortion_model of the left camera is [1, 2]')], ids=str)
def test_ros_calibrations_of_another_lens_are_refused(tmp_path, how, told):
    with pytest.raises(ValueError) as refused:
        read_calibration(written_pair(tmp_path, **how), False)
    assert told in str(refused.value)


def kalibr_document():
    """camchain.yaml of the cameras of EuRoC."""
    left, right = euroc_documents()
    body_from = [np.reshape(camera['T_BS']['data'], (4, 4)) for camera in (left, right)]
    cameras = {f'cam{number}': {
        'camera_model': 'pinhole', 'distortion_model': 'radtan', 'intrinsics': camera['intrinsics'],
        'distortion_coeffs': camera['distortion_coefficients'], 'resolution': list(EUROC_SIZE),
        'cam_overlaps': [1 - number], 'rostopic': f'/cam{number}/image_raw'}
        for number, camera in enumerate((left, right))}
    cameras['cam1']['T_cn_cnm1'] = (np.linalg.inv(body_from[1]) @ body_from[0]).tolist()
    return cameras


def test_kalibr_is_read_as_euroc_with_the_same_cameras(tmp_path):
    chain = tmp_path / 'camchain-rig.yaml'
    chain.write_text(yaml.safe_dump(kalibr_document()))
    ours, expected = read_calibration([chain], False), read_calibration(write_euroc(tmp_path), False)
    for side in ('left', 'right'):
        for name in ('k', 'd', 'r', 'p'):
            own, other = (getattr(calibration.camera(side), name) for calibration in (ours, expected))
            np.testing.assert_allclose(own, other, atol=1e-9)
    with pytest.raises(ValueError, match='calibration of both cameras: give --calib once'):
        read_calibration([chain, chain], False)


@pytest.mark.parametrize(('camera', 'change', 'told'), [
    ('cam1', {'T_cn_cnm1': np.diag([1.0, 1, 2, 1]).tolist()}, 'T_cn_cnm1 of the right camera must be a rotation'),
    ('cam1', {'T_cn_cnm1': None}, 'T_cn_cnm1 of the right camera must be 16 numbers'),
    ('cam0', {'camera_model': 'omni'}, "camera_model of cam0 is 'omni', it must be pinhole"),
    ('cam1', {'distortion_model': 'equidistant'}, "distortion_model of the right camera is 'equidistant'")])
def test_what_is_wrong_with_a_kalibr_file_is_told(tmp_path, camera, change, told):
    document = kalibr_document()
    document[camera] |= change
    chain = tmp_path / 'camchain.yaml'
    chain.write_text(yaml.safe_dump(document))
    with pytest.raises(ValueError, match=told):
        read_calibration([chain], False)


def test_one_camera_of_kalibr_is_refused(tmp_path):
    chain = tmp_path / 'camchain.yaml'
    chain.write_text(yaml.safe_dump({'cam0': kalibr_document()['cam0']}))
    with pytest.raises(ValueError, match='cam1 is missing'):
        read_calibration([chain], False)


def test_driving_stereo_is_read(tmp_path):
    def row(shift):
        return f'1003.6 0 376 {shift} 0 1003.6 240 0 0 0 1 0'

    path = tmp_path / '2018-07-16.txt'
    path.write_text('S_101: 752 480\nS_rect_101: 752 480\nS_rect_103: 752 480\n'
                    f'P_rect_101: {row(0)}\nP_rect_103: {row(-546.7)}\n')
    calibration = read_calibration([path], True)
    assert geometry(calibration) == pytest.approx((1003.6, 546.7 / 1003.6, 0))
    assert (calibration.source, calibration.left.size, calibration.is_rectified) == ('DrivingStereo', SIZE, True)


@pytest.mark.parametrize(('name', 'text', 'told'), [
    ('ost.txt', '# oST version 5.0 parameters\n\n[image]\n\nwidth\n752\n\n[narrow_stereo/left]\n', 'is ost.txt of ROS'),
    ('SN1.conf', '[LEFT_CAM_HD]\nfx=700.5\n[STEREO]\nBaseline=119.87\n', 'is the factory calibration of a ZED'),
    ('EuRoC.yaml', '%YAML:1.0\n\nCamera.fx: 435.2\nLEFT.width: 752\n', 'is the settings of ORB-SLAM'),
    ('intrinsics.yml', '%YAML:1.0\n---\nM1: !!opencv-matrix\n   rows: 1\n   cols: 1\n   dt: d\n   data: [ 1. ]\n',
     "is intrinsics of OpenCV's stereo_calib"),
    ('K.txt', '754.6 0.0 489.3 0.0 754.6 265.1 0.0 0.0 1.0\n0.063\n',
     'line 1 has 9 numbers, a projection matrix has 12'),
])
def test_files_of_other_tools_are_refused_by_name(tmp_path, name, text, told):
    (tmp_path / name).write_text(text)
    with pytest.raises(ValueError, match=told):
        read_calibration([tmp_path / name], False)
