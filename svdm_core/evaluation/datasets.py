"""Stereo pairs with ground truth in Middlebury's folder layout."""
from __future__ import annotations

import dataclasses
from pathlib import Path

import cv2
import numpy as np

from ..files.images import read_image
from ..files.pfm import read_pfm
from ..files.user_files import SETTINGS, read_text
from ..kernels.arrays import Bool, Float32, Image
from .pair_folders import parse_ndisp

# Middlebury v3 counts the scenes with the harder light or structure half.
MIDDLEBURY_WEIGHTS = dict.fromkeys(('PianoL', 'Playroom', 'Playtable', 'Shelves', 'Vintage'), 0.5)


# Names of the ground truth: here, and in the archives of the Middlebury evaluation.
_TRUTH_NAMES = ('disp0.pfm', 'disp0GT.pfm')


@dataclasses.dataclass(frozen=True, slots=True)
class StereoScene:
    """left, right: uint8, BGR (H, W, 3) or grey (H, W); ground_truth: float32 (H, W) px, not finite where unknown;
    nonocc: bool (H, W), True where the right image sees it too; num_disparities: what has to be searched, px.

    Raises ValueError where sizes differ, where no ground truth is known, or where it cannot be disparities.
    """

    name: str
    left: Image
    right: Image
    ground_truth: Float32
    nonocc: Bool
    num_disparities: int

    def __post_init__(self) -> None:
        sizes = {'left image': self.left, 'right image': self.right, 'ground truth': self.ground_truth,
                 'mask': self.nonocc}
        if len({image.shape[:2] for image in sizes.values()}) > 1:
            told = ', '.join(f'{what} {image.shape[1]} x {image.shape[0]}' for what, image in sizes.items())
            raise ValueError(f'{self.name}: the sizes differ: {told}')
        known = self.ground_truth[np.isfinite(self.ground_truth)]
        if not (np.isfinite(self.ground_truth) & self.nonocc).any():
            raise ValueError(f'{self.name}: no visible pixel has known ground truth')
        width = self.left.shape[1]
        # Numbers read in the wrong byte order are huge, negative or below the smallest normal number.
        tiny = (known != 0) & (np.abs(known) < np.finfo(np.float32).tiny)
        if known.min() < 0 or known.max() > width or tiny.any():
            raise ValueError(f'{self.name}: ground truth from {known.min():g} to {known.max():g} px, not within the '
                             f'{width} px of the image: wrong byte order?')

    @property
    def min_disparity(self) -> int:
        """px; ground truth begins at 0."""
        return 0

    def grey(self) -> StereoScene:
        """The scene without colour."""
        if self.left.ndim == 2:
            return self
        left, right = (np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)) for image in (self.left, self.right))
        return dataclasses.replace(self, left=left, right=right)


def middlebury_scenes(folder: Path) -> list[Path]:
    """The scene folders (those with an im0.png) right below `folder`. ValueError where there is none."""
    scenes = sorted(path.parent for path in folder.glob('*/im0.png'))
    if not scenes:
        raise ValueError(f'{folder}: no scene in it; expected folders with im0.png, im1.png, disp0.pfm, '
                         'mask0nocc.png and calib.txt')
    return scenes


def read_middlebury_scene(folder: Path) -> StereoScene:
    """Read one scene. ValueError or FileNotFoundError name the file that is missing or wrong."""
    left, right = read_image(folder / 'im0.png'), read_image(folder / 'im1.png')
    lines = read_text(folder / 'calib.txt', SETTINGS).splitlines()
    num_disparities = parse_ndisp(lines)
    if num_disparities is None:
        raise ValueError(f'{folder / "calib.txt"}: no line ndisp=<number>')
    nonocc = read_image(folder / 'mask0nocc.png', cv2.IMREAD_GRAYSCALE) == 255
    truths = [folder / name for name in _TRUTH_NAMES if (folder / name).is_file()]
    if not truths:
        raise FileNotFoundError(f'{folder}: no {" nor ".join(_TRUTH_NAMES)} in it')
    return StereoScene(folder.resolve().name, left, right, read_pfm(truths[0]), nonocc, num_disparities)
