"""Calibration files written as KITTI, EuRoC, Middlebury and ROS write them."""
import cv2
import numpy as np
import yaml

MIDDLEBURY = '''cam0=[1000 0 400; 0 1000 300; 0 0 1]
cam1=[1000 0 450; 0 1000 300; 0 0 1]
doffs=50
baseline=200
width=800
height=600
ndisp=64
'''
KITTI_MATRICES = [
    [[700.0, 0, 600, 0], [0, 700, 180, 0], [0, 0, 1, 0]],
    [[700.0, 0, 600, -378], [0, 700, 180, 0], [0, 0, 1, 0]],
    [[700.0, 0, 600, 42], [0, 700, 180, -0.1], [0, 0, 1, 0.003]],
    [[700.0, 0, 600, -336], [0, 700, 180, 1.0], [0, 0, 1, 0.003]],
]
EUROC_SIZE, EUROC_BASELINE = (752, 480), 0.11


def write_kitti(folder, kind):
    """All four cameras, as the odometry set, as the raw data set, or as bare lines; the file."""
    path = folder / 'calib.txt'
    rows = [' '.join(f'{value:.12e}' for value in np.ravel(matrix)) for matrix in KITTI_MATRICES]
    lines = {
        'odometry': [*(f'P{n}: {row}' for n, row in enumerate(rows)), 'Tr: 1 0 0 0 0 1 0 0 0 0 1 0'],
        'raw': ['calib_time: 09-Jan-2012 13:57:47', *(f'S_rect_0{n}: 1.242000e+03 3.750000e+02' for n in range(4)),
                *(f'P_rect_0{n}: {row}' for n, row in enumerate(rows))],
        'lines': rows,
    }[kind]
    path.write_text('\n'.join(lines) + '\n')
    return path


def euroc_documents():
    """sensor.yaml of cam0 and cam1: raw cameras, turned against the body and a little against each other."""
    body_from_left = transform((0.2, -1.4, 0.3), (0.02, 0.01, 0.05))
    left_from_right = transform((0.01, -0.02, 0.005), (EUROC_BASELINE, 0, 0))
    return [
        {'sensor_type': 'camera', 'rate_hz': 20, 'resolution': list(EUROC_SIZE), 'camera_model': 'pinhole',
         'T_BS': {'cols': 4, 'rows': 4, 'data': body_from_camera.ravel().tolist()}, 'intrinsics': intrinsics,
         'distortion_model': 'radial-tangential', 'distortion_coefficients': distortion}
        for body_from_camera, intrinsics, distortion in (
            (body_from_left, [458.0, 457.0, 367.0, 248.0], [-0.28, 0.07, 0.0002, 1e-5]),
            (body_from_left @ left_from_right, [457.0, 456.0, 379.0, 255.0], [-0.27, 0.06, -0.0001, 3e-5]))
    ]


def transform(rotation, translation):
    """(4, 4) of a rotation vector and a translation."""
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = cv2.Rodrigues(np.array(rotation, float))[0], translation
    return matrix


def write_euroc(folder):
    """folder/cam0/sensor.yaml and folder/cam1/sensor.yaml; both files."""
    files = []
    for number, document in enumerate(euroc_documents()):
        files.append(folder / f'cam{number}' / 'sensor.yaml')
        files[-1].parent.mkdir(parents=True, exist_ok=True)
        files[-1].write_text('# General sensor definitions.\n' + yaml.safe_dump(document))
    return files


def write_ros(folder):
    """The same cameras as camera_calibration writes them, rectified by OpenCV; left.yaml and right.yaml."""
    left, right = euroc_documents()
    k, d = [], []
    for camera in (left, right):
        f_x, f_y, c_x, c_y = camera['intrinsics']
        k.append(np.array([[f_x, 0, c_x], [0, f_y, c_y], [0, 0, 1]]))
        d.append(np.array([*camera['distortion_coefficients'], 0.0]))
    body_from_left, body_from_right = (np.reshape(camera['T_BS']['data'], (4, 4)) for camera in (left, right))
    right_from_left = np.linalg.inv(body_from_right) @ body_from_left
    rotation, translation = right_from_left[:3, :3].copy(), right_from_left[:3, 3:].copy()
    r_p = cv2.stereoRectify(k[0], d[0], k[1], d[1], EUROC_SIZE, rotation, translation,
                            flags=cv2.CALIB_ZERO_DISPARITY, alpha=0)
    files = []
    for side, name in enumerate(('left', 'right')):
        matrices = {'camera_matrix': k[side], 'distortion_coefficients': d[side][None],
                    'rectification_matrix': r_p[side], 'projection_matrix': r_p[2 + side]}
        files.append(folder / f'{name}.yaml')
        files[-1].write_text(yaml.safe_dump({
            'image_width': EUROC_SIZE[0], 'image_height': EUROC_SIZE[1], 'camera_name': name,
            'distortion_model': 'plumb_bob',
            **{key: {'rows': value.shape[0], 'cols': value.shape[1], 'data': value.ravel().tolist()}
               for key, value in matrices.items()}}))
    return files
