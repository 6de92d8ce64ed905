"""Ground truth beside the images: its files, as Middlebury and KITTI have them."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from svdm_core.evaluation.kitti import read_kitti_truth
from svdm_core.files.pfm import read_pfm
from svdm_core.files.user_files import IMAGE, check_regular
from svdm_core.kernels.arrays import Float32

from ...calibration.stereo_calibration import Size
from .image_files import FilePair


def truth_files(truth: Path, pairs: Sequence[FilePair]) -> Mapping[Path, Path]:
    """Left image -> its ground truth, by the same name in the folder `truth`; a file `truth` is that of the one pair.

    Raises ValueError where none belongs to any.
    """
    if truth.is_file():
        if len(pairs) > 1:
            raise ValueError(f'{truth} is one file for {len(pairs)} pairs: name the folder of the ground truth')
        return {pairs[0].left: truth}
    if not truth.is_dir():
        if truth.exists():
            check_regular(truth, IMAGE)
        raise ValueError(f'{truth}: there is no such folder')
    there = {path.stem: path for path in truth.iterdir() if path.suffix.lower() in ('.png', '.pfm')}
    found = {pair.left: there[pair.left.stem] for pair in pairs if pair.left.stem in there}
    if not found:
        raise ValueError(f'{truth}: no .png or .pfm in it is named like a left image, as {pairs[0].left.stem}')
    return found


def read_truth(path: Path, size: Size) -> Float32:
    """float32 (H, W), px, not finite where unknown, of a PFM or a 16-bit PNG of KITTI.

    Raises ValueError where it is none, knows no pixel, or is not of `size` (width, height in px).
    """
    check_regular(path, IMAGE)
    truth = read_pfm(path) if path.suffix.lower() == '.pfm' else read_kitti_truth(path)
    if truth.shape != size[::-1]:
        raise ValueError(f'{path} has {truth.shape[1]}x{truth.shape[0]} px, the images have {size[0]}x{size[1]}: give '
                         'the ground truth of these images')
    if not np.isfinite(truth).any():
        raise ValueError(f'{path}: no pixel has known ground truth')
    return truth
