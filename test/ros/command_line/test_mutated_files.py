"""Calibrations, parameter files and images that are almost right are read, or refused in one line; nothing else."""
import dataclasses

import cv2
import numpy as np
import pytest
import yaml
from calibrations import MIDDLEBURY, euroc_documents, write_euroc, write_kitti, write_ros
from hypothesis import given
from hypothesis import strategies as st
from mutations import mutated

from svdm_core import MatcherParameters, load_preset, preset_names
from svdm_core.files.pfm import encode_pfm
from svdm_core.presets import preset_folder
from svdm_ros.bags.images.ground_truth import read_truth
from svdm_ros.bags.images.image_files import read_pixels
from svdm_ros.calibration.calibration_files import read_calibration
from svdm_ros.calibration.stereo_calibration import Rectifier, StereoCalibration

LONGEST_LINE = 1500
SIZE = (16, 12)
PARTNERS = {'ros.yaml': 'right.yaml', 'opencv.yaml': 'right.yaml', 'euroc.yaml': 'cam1/sensor.yaml'}
PRESETS = {f'{name}.yaml': (preset_folder() / f'{name}.yaml').read_bytes() for name in preset_names()}


def kalibr():
    cameras = {f'cam{number}': {
        'camera_model': 'pinhole', 'distortion_model': 'radtan', 'intrinsics': document['intrinsics'],
        'distortion_coeffs': document['distortion_coefficients'], 'resolution': document['resolution'],
        'T_cn_cnm1': [[1.0, 0, 0, -0.11], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]]}
        for number, document in enumerate(euroc_documents())}
    return yaml.safe_dump(cameras).encode()


def images():
    pixels = np.random.default_rng(1).integers(0, 255, SIZE[::-1], np.uint8)
    kinds = dict.fromkeys(['8.png', 'a.pgm', 'a.jpg', 'a.tiff'], pixels) | {'16.png': pixels.astype(np.uint16) * 200}
    files = {name: cv2.imencode(f'.{name.partition(".")[2]}', image)[1].tobytes() for name, image in kinds.items()}
    return files | {'a.pfm': encode_pfm(pixels.astype(np.float32))}


IMAGES = images()


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """With the files of the right cameras."""
    return tmp_path_factory.mktemp('mutated')


@pytest.fixture(scope='module')
def calibrations(folder):
    left, euroc = write_ros(folder)[0].read_bytes(), write_euroc(folder)[0].read_bytes()
    kitti = {f'{kind}.txt': write_kitti(folder, kind).read_bytes() for kind in ('odometry', 'raw', 'lines')}
    lines = [line for line in kitti['raw.txt'].splitlines(True) if b'_02' not in line and b'_03' not in line]
    stereo = b''.join(lines).replace(b'_00', b'_101').replace(b'_01', b'_103')
    opencv = b'%YAML:1.0\n---\n' + left.replace(b'matrix:\n', b'matrix: !!opencv-matrix\n')
    return kitti | {'driving.txt': stereo, 'middlebury.txt': MIDDLEBURY.encode(), 'kalibr.yaml': kalibr(),
                    'ros.yaml': left, 'opencv.yaml': opencv, 'euroc.yaml': euroc}


def outcome(read, path, content):
    """What is read; None where it is refused in a line."""
    path.write_bytes(content)
    try:
        return read(path)
    except ValueError as error:
        assert str(error).isprintable() and len(str(error)) < LONGEST_LINE, str(error)
        return None


def calibration_of(path):
    partner = PARTNERS.get(path.name)
    return read_calibration([path, path.parent / partner] if partner else [path], False)


def image_of(path):
    return read_truth(path, SIZE) if path.suffix == '.pfm' else read_pixels(path)


def test_the_originals_are_read(folder, calibrations):
    assert all(outcome(calibration_of, folder / name, text) for name, text in calibrations.items())
    assert all(outcome(load_preset, folder / name, text) for name, text in PRESETS.items())
    assert all(outcome(image_of, folder / name, content) is not None for name, content in IMAGES.items())


@given(data=st.data())
def test_calibrations(folder, calibrations, data):
    name, text = data.draw(mutated(calibrations))
    calibration = outcome(calibration_of, folder / name, text)
    if calibration is not None:
        assert isinstance(calibration, StereoCalibration) and calibration.baseline > 0
        for camera in (calibration.left, calibration.right):
            Rectifier(dataclasses.replace(camera, size=SIZE))(np.zeros(SIZE[::-1], np.uint8))


@given(mutated(PRESETS))
def test_parameter_files(folder, mutated_file):
    name, text = mutated_file
    parameters = outcome(load_preset, folder / name, text)
    assert parameters is None or isinstance(parameters, MatcherParameters)


@given(mutated(IMAGES))
def test_images(folder, mutated_file):
    name, content = mutated_file
    image = outcome(image_of, folder / name, content)
    assert image is None or image.dtype in (np.uint8, np.uint16, np.float32)
