"""Scenes with ground truth written as files, in the layouts that `svdm evaluate` reads."""
import cv2
import numpy as np
from scenes import shifted_wall

from svdm_core.commands import cli

SHIFT = 6
SIZE = (40, 90)
OCCLUDED = np.s_[:, :SHIFT]  # the columns that the right image does not show
EXACT = {'subpixel': False, 'sigma_tree': 10.0}  # finds the walls without any error
KITTI = {
    'KITTI 2015': ('image_2', 'image_3', 'disp_noc_0', 'disp_occ_0'),
    'KITTI 2012': ('colored_0', 'colored_1', 'disp_noc', 'disp_occ'),
    'KITTI 2012 grey': ('image_0', 'image_1', 'disp_noc', 'disp_occ'),
}


def write_pfm(path, values, scale=-1.0, kind='Pf'):
    """A PFM of (H, W), big-endian where `scale` is positive."""
    data = values[::-1].astype('<f4' if scale < 0 else '>f4').tobytes()
    path.write_bytes(f'{kind}\n{values.shape[1]} {values.shape[0]}\n{scale}\n'.encode() + data)
    return path


def wall_truth(value=float(SHIFT)):
    """Known everywhere but in the last row."""
    truth = np.full(SIZE, value, np.float32)
    truth[-1] = np.inf
    return truth


def truth_off(visible, occluded):
    """The wall's truth, off by `visible` px in one column that both views show and by `occluded` px in another."""
    truth = wall_truth()
    truth[:-1, 50] += visible
    truth[:-1, 2] += occluded
    return truth


def write_middlebury(folder, truth=None, truth_name='disp0.pfm', ndisp=16, seed=1):
    """A random-dot wall at SHIFT px; returns the folder."""
    folder.mkdir(parents=True)
    for name, image in zip(('im0', 'im1'), shifted_wall(*SIZE, SHIFT, seed), strict=True):
        cv2.imwrite(str(folder / f'{name}.png'), cv2.merge([image] * 3))
    mask = np.full(SIZE, 255, np.uint8)
    mask[OCCLUDED] = 128
    cv2.imwrite(str(folder / 'mask0nocc.png'), mask)
    write_pfm(folder / truth_name, wall_truth() if truth is None else truth)
    (folder / 'calib.txt').write_text(f'cam0=[1 0 0; 0 1 0; 0 0 1]\nndisp={ndisp}\n')
    return folder


def write_kitti(folder, left, right, nonocc, everywhere, name='000000_10', truth=None):
    """The same wall below folder/training; the next frame has images and no truth, as in KITTI. Returns `folder`."""
    truth = wall_truth() if truth is None else truth
    steps = np.where(np.isfinite(truth), np.nan_to_num(truth, posinf=0) * 256, 0).astype(np.uint16)
    visible = steps.copy()
    visible[OCCLUDED] = 0
    images = shifted_wall(*SIZE, SHIFT)
    for part, image in ((left, images[0]), (right, images[1]), (nonocc, visible), (everywhere, steps)):
        (folder / 'training' / part).mkdir(parents=True, exist_ok=True)
        cv2.imwrite(str(folder / 'training' / part / f'{name}.png'), image)
    for part in (left, right):
        cv2.imwrite(str(folder / 'training' / part / name.replace('_10', '_11.png')), images[0])
    return folder


def files_of(folder):
    """Everything below `folder` with its content, to see that nothing has changed."""
    return {path: path.read_bytes() for path in folder.rglob('*') if path.is_file()}


def evaluate(folder, *arguments):
    """`svdm evaluate` with the settings that find the walls; its exit code."""
    settings = [f'{name}={value}' for name, value in EXACT.items()]
    return cli.main(['evaluate', str(folder), '--set', *settings, '--threads', '1', *map(str, arguments)])
