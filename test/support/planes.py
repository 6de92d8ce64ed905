"""Two textured planes seen by a pair of cameras, rendered ray by ray: raw images with distortion, and rectified ones.

The lens equations stand here once more, written from OpenCV's documentation, not by its functions.
"""
from types import SimpleNamespace

import cv2
import numpy as np

PLANES = ((0.0, 1.0, 1), (0.5, 0.75, 2))
"""A wall at 1 m and a slanted plane before its left part: Z = slope X + distance (m), and the seed of its texture."""


def camera_info(size, model, d, k, r, p, **fields):
    """sensor_msgs/CameraInfo in no message library; k: f_x, f_y, c_x, c_y; r: rotation vector; p: f, c_x, c_y, P[3]."""
    rotation = cv2.Rodrigues(np.array(r, float))[0]
    whole = SimpleNamespace(x_offset=0, y_offset=0, width=0, height=0, do_rectify=False)
    return SimpleNamespace(**{
        'width': size[0], 'height': size[1], 'distortion_model': model, 'd': [float(value) for value in d],
        'k': [k[0], 0.0, k[2], 0.0, k[1], k[3], 0.0, 0.0, 1.0], 'r': rotation.ravel().tolist(),
        'p': [p[0], 0.0, p[1], p[3], 0.0, p[0], p[2], 0.0, 0.0, 0.0, 1.0, 0.0],
        'binning_x': 0, 'binning_y': 0, 'roi': whole, **fields})


def distorted(x, y, model, d):
    """Where the ray (x, y, 1) meets the plane of K: OpenCV's equations, fisheye and rational with prism and tilt."""
    if model == 'equidistant':
        r = np.hypot(x, y)
        theta = np.arctan(r)
        bent = theta * (1 + d[0] * theta**2 + d[1] * theta**4 + d[2] * theta**6 + d[3] * theta**8)
        scale = np.where(r > 1e-9, bent / np.maximum(r, 1e-9), 1)
        return x * scale, y * scale
    k1, k2, p1, p2, k3, k4, k5, k6, s1, s2, s3, s4, tau_x, tau_y = (*d, *np.zeros(14 - len(d)))
    r2 = x**2 + y**2
    radial = (1 + k1 * r2 + k2 * r2**2 + k3 * r2**3) / (1 + k4 * r2 + k5 * r2**2 + k6 * r2**3)
    bent_x = x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x**2) + s1 * r2 + s2 * r2**2
    bent_y = y * radial + p1 * (r2 + 2 * y**2) + 2 * p2 * x * y + s3 * r2 + s4 * r2**2
    about_x = np.array([[1, 0, 0], [0, np.cos(tau_x), np.sin(tau_x)], [0, -np.sin(tau_x), np.cos(tau_x)]])
    about_y = np.array([[np.cos(tau_y), 0, -np.sin(tau_y)], [0, 1, 0], [np.sin(tau_y), 0, np.cos(tau_y)]])
    turn = about_y @ about_x
    onto_sensor = np.array([[turn[2, 2], 0, -turn[0, 2]], [0, turn[2, 2], -turn[1, 2]], [0, 0, 1]]) @ turn
    tilted = np.tensordot(onto_sensor, np.stack([bent_x, bent_y, np.ones_like(bent_x)]), 1)
    return tilted[0] / tilted[2], tilted[1] / tilted[2]


def undistorted(bent_x, bent_y, model, d):
    """The inverse of `distorted`, by Newton's method with differences."""
    r = np.hypot(bent_x, bent_y)
    start = np.tan(np.minimum(r, 1.2)) / np.maximum(r, 1e-9) if model == 'equidistant' else 1
    x, y, step = bent_x * start, bent_y * start, 1e-6
    for _ in range(12):
        found_x, found_y = distorted(x, y, model, d)
        error_x, error_y = found_x - bent_x, found_y - bent_y
        if max(np.abs(error_x).max(), np.abs(error_y).max()) < 1e-9:
            return x, y
        (a, c), (b, e) = (
            (np.array(distorted(x + right, y + down, model, d)) - distorted(x - right, y - down, model, d)) / (2 * step)
            for right, down in ((step, 0), (0, step)))
        x, y = x - (e * error_x - b * error_y) / (a * e - b * c), y - (a * error_y - c * error_x) / (a * e - b * c)
    raise AssertionError('the distortion has no inverse in this image')


def raw_position(info, u, v):
    """The raw pixel (x, y) that the rectified pixel (u, v) is taken from, sensor px without roi and binning."""
    r, k, p = np.reshape(info.r, (3, 3)), np.reshape(info.k, (3, 3)), np.reshape(info.p, (3, 4))
    ray = np.tensordot(r.T, np.stack([(u - p[0, 2]) / p[0, 0], (v - p[1, 2]) / p[1, 1], np.ones_like(u)]), 1)
    x, y = distorted(ray[0] / ray[2], ray[1] / ray[2], info.distortion_model or 'plumb_bob', info.d)
    return k[0, 0] * x + k[0, 2], k[1, 1] * y + k[1, 2]


def render(info, raw):
    """The image (H, W) uint8 of a camera, raw or rectified, and the depth Z (m) along the axis of the rectified camera.

    The world is the frame of the rectified left camera; P[3] moves the camera to the right.
    """
    u, v = np.meshgrid(np.arange(info.width, dtype=float), np.arange(info.height, dtype=float))
    p = np.reshape(info.p, (3, 4))
    if raw:
        k = np.reshape(info.k, (3, 3))
        x, y = undistorted((u - k[0, 2]) / k[0, 0], (v - k[1, 2]) / k[1, 1], info.distortion_model, info.d)
        ray = np.tensordot(np.reshape(info.r, (3, 3)), np.stack([x, y, np.ones_like(x)]), 1)
    else:
        ray = np.stack([(u - p[0, 2]) / p[0, 0], (v - p[1, 2]) / p[1, 1], np.ones_like(u)])
    x, y, baseline = ray[0] / ray[2], ray[1] / ray[2], -p[0, 3] / p[0, 0]
    grey, depth = np.zeros(u.shape), np.full(u.shape, np.inf)
    for slope, distance, seed in PLANES:
        z = (slope * baseline + distance) / (1 - slope * x)
        nearer = (z > 0) & (z < depth)
        depth = np.where(nearer, z, depth)
        grey = np.where(nearer, _texture(baseline + x * z, y * z, seed), grey)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8), depth


def _texture(x, y, seed):
    """Grey of a point of a plane (m): waves of 2 to 12 cm, so that nothing is finer than some pixels."""
    generator, waves = np.random.default_rng(seed), 40
    grey = np.zeros_like(x)
    for _ in range(waves):
        direction, phase = generator.uniform(0, 2 * np.pi, 2)
        number = 2 * np.pi / generator.uniform(0.02, 0.12)
        grey += np.cos(number * (x * np.cos(direction) + y * np.sin(direction)) + phase)
    return 128 + 45 * grey / np.sqrt(waves / 2)
