"""Image files of two cameras: which belong together, when they were taken, and their pixels."""
from __future__ import annotations

import dataclasses
import re
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from svdm_core.files.images import read_image
from svdm_core.files.user_files import IMAGE, TIMES, check_regular, read_text
from svdm_core.shown import cut, shown

SUFFIXES = ('.png', '.jpg', '.jpeg', '.bmp', '.tif', '.tiff', '.pgm', '.ppm')
TIMES_FILES = ('times.txt', 'timestamps.txt')
"""Of KITTI: seconds a line, or date and time a line; beside the images or one folder up."""
_STAMP = re.compile(r'\d{16,19}')
"""A file name that is a time in ns, as EuRoC has them."""
_FIRST_STAMP = 1_000_000_000
"""ns; where nothing tells the time, it begins here, as stamp 0 means «no time» in ROS."""
_AS_IT_IS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR


@dataclasses.dataclass(frozen=True, slots=True)
class FilePair:
    """Two image files of one moment; `stamp` in ns."""

    stamp: int
    left: Path
    right: Path


@dataclasses.dataclass(frozen=True, slots=True)
class FilePairs:
    """The pairs in order of time; the files left out for want of a partner; where the stamps come from."""

    pairs: tuple[FilePair, ...]
    unpaired: tuple[Path, ...]
    stamps_from: str


def find_pairs(left: Path, right: Path, rate: float | None) -> FilePairs:
    """Pair the images of two folders, or two single images.

    Files of the same name belong together; where no two names are the same, the n-th of either folder in natural
    order.
    Stamps are the file names where those are ns (images without a partner are then left out), else the lines of a
    times.txt, else `rate` Hz (10 where None). A `rate` replaces either.
    Raises ValueError naming the folder or file that does not fit.
    """
    files = {side: _images(path) for side, path in (('left', left), ('right', right))}
    if left.is_dir() and left.resolve() == right.resolve():
        raise ValueError(f'{left} is given for both sides: name the folder of each, or two files')
    named = all(_STAMP.fullmatch(path.stem) for paths in files.values() for path in paths)
    matched, unpaired = _match(files['left'], files['right'], leave_out=named)
    if rate is None and named:
        stamps, source = [int(first.stem) for first, _ in matched], 'file names'
    elif rate is None and (times := _times_file(left)) is not None:
        stamps, source = _read_times(times, len(matched)), str(times)
    else:
        rate = 10.0 if rate is None else rate
        stamps, source = [_FIRST_STAMP + round(n * 1e9 / rate) for n in range(len(matched))], f'{rate:g} Hz'
    pairs = tuple(FilePair(stamp, *both) for stamp, both in zip(stamps, matched, strict=True))
    return FilePairs(pairs, tuple(unpaired), source)


def _images(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    if not path.is_dir():
        if path.exists():
            check_regular(path, IMAGE)
        raise ValueError(f'{path}: there is no such folder')
    found = [file for file in path.iterdir() if file.suffix.lower() in SUFFIXES and not file.name.startswith('.')]
    if not found:
        raise ValueError(f'{path}: no image in it ({", ".join(SUFFIXES)})')
    return sorted(found, key=natural_order)


def natural_order(path: Path) -> list[tuple[int, str]]:
    """Sorts image_2 before image_10."""
    return [(int(part), '') if part.isdecimal() else (-1, part) for part in re.split(r'(\d+)', path.stem)]


def _match(
    left: Sequence[Path], right: Sequence[Path], leave_out: bool
) -> tuple[list[tuple[Path, Path]], list[Path]]:
    """The pairs, and the files without a partner, of which there are none unless `leave_out`."""
    by_name = {path.stem: path for path in right}
    names = {path.stem for path in left}
    single = [path for path in left if path.stem not in by_name] + [path for path in right if path.stem not in names]
    named_alike = len(single) < len(left) + len(right)
    if not single or (leave_out and named_alike):
        return [(path, by_name[path.stem]) for path in left if path.stem in by_name], single
    if named_alike:  # by their order they would be paired wrongly from here on
        raise ValueError(f'{single[0]} has no partner of its name on the other side, as {len(single)} of '
                         f'{len(left) + len(right)} images: remove these, or add their partners')
    if len(left) != len(right):
        raise ValueError(f'{left[0].parent} has {len(left)} images and {right[0].parent} has {len(right)}, and none '
                         'has the name of one on the other side: both need as many')
    return list(zip(left, right, strict=True)), []


def _times_file(images: Path) -> Path | None:
    """Beside the images or one folder up: sequences/00/times.txt, image_00/timestamps.txt."""
    folder = (images if images.is_dir() else images.parent).resolve()
    places = [place / name for place in (folder, folder.parent) for name in TIMES_FILES]
    return next((place for place in places if place.exists()), None)


def _read_times(path: Path, count: int) -> list[int]:
    lines = [line.strip() for line in read_text(path, TIMES).splitlines() if line.strip()]
    if len(lines) != count:
        raise ValueError(f'{path} has {len(lines)} times for {count} pairs: make it fit, or give --rate')
    stamps = []
    for number, line in enumerate(lines, 1):
        try:
            stamps.append(_time(line))
        except (ValueError, OverflowError):
            raise ValueError(f'{path}: line {number} is {shown(line)}, it must be seconds, or date and time') from None
        if stamps[-1] < 0 or (number > 1 and stamps[-1] <= stamps[-2]):
            raise ValueError(f'{path}: the time of line {number}, {cut(line)}, is not after the one before')
    return stamps


def _time(line: str) -> int:
    """ns of '1.036e-01' or of '2011-09-26 13:02:25.964389445' (UTC)."""
    if '-' in line[1:] and ':' in line:
        moment, _, fraction = line.partition('.')
        second = datetime.strptime(moment, '%Y-%m-%d %H:%M:%S').replace(tzinfo=UTC)
        return int(second.timestamp()) * 10**9 + int((fraction or '0').ljust(9, '0')[:9])
    return round(float(line) * 1e9)


def read_checked(path: Path, flags: int) -> NDArray[Any]:
    """`read_image` of a size that OpenCV takes. Raises ValueError."""
    try:
        return read_image(path, flags)
    except cv2.error as error:
        raise ValueError(f'{path}: OpenCV does not read it ({cut(str(error))})') from None


def read_pixels(path: Path) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """uint8 (H, W) or (H, W, 3) in the order B, G, R, or uint16 (H, W). ValueError for anything else, or no image."""
    image = read_checked(path, _AS_IT_IS)
    if image.dtype == np.uint8 or (image.dtype == np.uint16 and image.ndim == 2):
        return image
    raise ValueError(f'{path}: an image of {image.dtype} with {1 if image.ndim == 2 else image.shape[2]} channels; '
                     'it must be 8 bit, or grey of 16 bit')
