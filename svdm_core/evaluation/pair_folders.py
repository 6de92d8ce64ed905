"""Pairs of images without ground truth: two files, folders of a left and a right camera, scenes."""
from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Protocol

import cv2

from ..files.images import read_image
from ..files.user_files import SETTINGS, read_text
from ..kernels.arrays import Image

_SIDES = (('left', 'right'), ('image_0', 'image_1'), ('image_2', 'image_3'), ('colored_0', 'colored_1'))
_SUFFIXES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm', '.ppm')
_AS_IT_IS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR


class PairSource(Protocol):
    """Pairs of the same two cameras. num_disparities: what the source says, px, or None. notes: what should be known of
    the pairs, after they were read."""

    @property
    def name(self) -> str: ...
    @property
    def num_disparities(self) -> int | None: ...
    @property
    def notes(self) -> Sequence[str]: ...

    def read(self, most: int) -> Iterator[tuple[Image, Image]]:
        """Up to `most` pairs, evenly over all. ValueError names what cannot be read."""
        ...


@dataclasses.dataclass(frozen=True, slots=True)
class CameraPairs:
    """files: left and right image of each pair of the same two cameras. num_disparities: what the folder says, px, or
    None."""

    name: str
    files: Sequence[tuple[Path, Path]]
    num_disparities: int | None = None
    notes: Sequence[str] = ()

    def read(self, most: int) -> Iterator[tuple[Image, Image]]:
        """Up to `most` pairs, evenly over all. ValueError names a file that cannot be read."""
        count = min(most, len(self.files))
        for number in range(count):
            left, right = self.files[number * len(self.files) // count]
            yield read_image(left, _AS_IT_IS), read_image(right, _AS_IT_IS)


def find_pairs(places: Sequence[Path]) -> list[CameraPairs]:
    """The pairs of two image files, of a folder with a folder of images for each camera, or of scenes with im0.png and
    im1.png, each of which is of cameras of its own. ValueError where there is none, naming what was looked for."""
    folder, *others = places
    if len(others) == 1:
        return [CameraPairs(folder.name, [(folder, others[0])])]
    if others or not folder.is_dir():
        what = f'{len(places)} places' if others else f'{folder}: ' + (
            'one file alone' if folder.exists() else 'there is no such file or folder')
        raise ValueError(f'{what}: give a folder of images, a recording, or a left and a right image')
    for left, right in _SIDES:
        if (folder / left).is_dir() and (folder / right).is_dir():
            return [CameraPairs(folder.resolve().name, _same_names(folder / left, folder / right))]
    scenes = [folder] if (folder / 'im0.png').is_file() else sorted(path.parent for path in folder.glob('*/im0.png'))
    if not scenes:
        told = ', '.join(f'{left} and {right}' for left, right in _SIDES)
        raise ValueError(f'{folder}: no pairs in it; expected folders {told} with images of the same names, or scenes '
                         'with im0.png and im1.png')
    return [CameraPairs(scene.resolve().name, [(scene / 'im0.png', scene / 'im1.png')], _ndisp(scene))
            for scene in scenes]


def _same_names(left: Path, right: Path) -> list[tuple[Path, Path]]:
    names = sorted(path.name for path in left.iterdir() if path.suffix.lower() in _SUFFIXES)
    pairs = [(left / name, right / name) for name in names if (right / name).is_file()]
    if not pairs:
        raise ValueError(f'{left} and {right}: no image has the same name in both')
    return pairs


def _ndisp(scene: Path) -> int | None:
    """Of calib.txt; None where there is none."""
    if not (scene / 'calib.txt').is_file():
        return None
    lines = read_text(scene / 'calib.txt', SETTINGS).splitlines()
    return parse_ndisp(lines)


def parse_ndisp(lines: Sequence[str]) -> int | None:
    """The number of disparities that lines of Middlebury's calib.txt say; None where they do not."""
    ndisp = next((line.partition('=')[2].strip() for line in lines if line.startswith('ndisp=')), '')
    return int(ndisp) if ndisp.isascii() and ndisp.isdigit() and len(ndisp) < 6 and int(ndisp) else None
