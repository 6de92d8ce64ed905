"""Stereo pairs with ground truth in the folder layouts of KITTI 2012 and KITTI 2015."""
from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np

from ..files.disparity_files import KITTI_SCALE
from ..files.images import read_image
from ..kernels.arrays import Float32, Image
from .datasets import StereoScene

# The files say nothing of the range; their 16-bit PNG ends below this.
KITTI_NUM_DISPARITIES = 256


@dataclasses.dataclass(frozen=True, slots=True)
class KittiLayout:
    """Folders of the left and right images, of the ground truth that both views see, and of all ground truth."""

    name: str
    left: str
    right: str
    nonocc: str
    all: str
    colour: bool = True


KITTI_LAYOUTS = (
    KittiLayout('KITTI 2015', 'image_2', 'image_3', 'disp_noc_0', 'disp_occ_0'),
    KittiLayout('KITTI 2012', 'colored_0', 'colored_1', 'disp_noc', 'disp_occ'),
    KittiLayout('KITTI 2012', 'image_0', 'image_1', 'disp_noc', 'disp_occ', colour=False),
)


def kitti_layout(folder: Path) -> KittiLayout | None:
    """The layout of `folder`, which holds image_2 and the like; None where it is none of KITTI's."""
    for layout in KITTI_LAYOUTS:
        if (folder / layout.left).is_dir() and (folder / layout.all).is_dir():
            return layout
    return None


def kitti_names(folder: Path, layout: KittiLayout) -> list[str]:
    """The frames with ground truth, as '000000_10'."""
    return sorted(path.stem for path in (folder / layout.all).glob('*.png'))


def read_kitti_scene(folder: Path, layout: KittiLayout, name: str) -> StereoScene:
    """Read one frame. ValueError names the file that is missing or wrong."""
    kind = cv2.IMREAD_COLOR if layout.colour else cv2.IMREAD_GRAYSCALE
    left, right = (read_image(folder / side / f'{name}.png', kind) for side in (layout.left, layout.right))
    nonocc = read_kitti_truth(folder / layout.nonocc / f'{name}.png')
    truth = read_kitti_truth(folder / layout.all / f'{name}.png')
    if nonocc.shape != truth.shape:
        raise ValueError(f'{name}: {layout.nonocc} has {nonocc.shape[1]} x {nonocc.shape[0]} pixels, '
                         f'{layout.all} {truth.shape[1]} x {truth.shape[0]}')
    return StereoScene(name, left, right, truth, np.isfinite(nonocc), KITTI_NUM_DISPARITIES)


def read_kitti_truth(path: Path) -> Float32:
    """Ground truth as float32 (H, W), px, inf where unknown. ValueError where it is no grey PNG of 16 bit."""
    steps: Image = read_image(path, cv2.IMREAD_UNCHANGED)
    if steps.dtype != np.uint16 or steps.ndim != 2:
        raise ValueError(f'{path}: {steps.dtype} with shape {steps.shape}; ground truth is a grey PNG of 16 bit')
    return np.where(steps > 0, steps.astype(np.float32) / np.float32(KITTI_SCALE), np.float32(np.inf))
