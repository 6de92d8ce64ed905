"""Scenes to tune on, and the command as a shell would start it."""
import argparse
import os
from pathlib import Path

import cv2
import numpy as np
import pytest
from scene_files import write_pfm
from scenes import two_walls

from svdm_core.commands import tune
from svdm_core.evaluation.datasets import middlebury_scenes, read_middlebury_scene


def write_scene(folder, seed, noise_level=25):
    """A square before a wall, with noise that makes the parameters matter."""
    folder.mkdir(parents=True)
    left, right, truth = two_walls(40, 70, near=9, far=3, seed=seed)
    rng = np.random.default_rng(seed)
    for name, image in (('im0', left), ('im1', right)):
        blurred = cv2.GaussianBlur(image, (0, 0), 1.5).astype(float) + rng.normal(0, noise_level, image.shape)
        cv2.imwrite(str(folder / f'{name}.png'), np.clip(blurred, 0, 255).astype(np.uint8))
    write_pfm(folder / 'disp0.pfm', truth.astype(np.float32))
    cv2.imwrite(str(folder / 'mask0nocc.png'), np.full(truth.shape, 255, np.uint8))
    (folder / 'calib.txt').write_text('ndisp=16\n')


def write_scenes(folder):
    """Three of them, of which the last counts half."""
    for seed, name in enumerate(('Attic', 'Barn', 'PianoL')):
        write_scene(folder / name, seed)
    return folder


def write_pairs(folder, count, contrast=1.0):
    """Folders left and right with so many pairs, of a camera that sees other walls each time."""
    for side in ('left', 'right'):
        (folder / side).mkdir(parents=True)
    for number in range(count):
        left, right, _ = two_walls(60, 90, near=9, far=3, seed=number)
        rng = np.random.default_rng(number)
        for side, image in (('left', left), ('right', right)):
            blurred = cv2.GaussianBlur(image, (0, 0), 1.2).astype(float) + rng.normal(0, 3, image.shape)
            levels = 128 + contrast * (blurred - 128)
            cv2.imwrite(str(folder / side / f'{number:06}.png'), np.clip(levels, 0, 255).astype(np.uint8))
    return folder


def real_scenes(*names):
    data = Path(os.environ.get('SVDM_DATA', 'unset')) / 'middlebury_v3_trainingQ'
    if not data.is_dir():
        pytest.skip('SVDM_DATA names no folder with middlebury_v3_trainingQ')
    return [read_middlebury_scene(path) for path in middlebury_scenes(data) if not names or path.name in names]


def run(*arguments):
    parser = argparse.ArgumentParser(prog='svdm tune')
    tune.add_arguments(parser)
    assert tune.run(parser.parse_args([str(argument) for argument in arguments])) == 0
