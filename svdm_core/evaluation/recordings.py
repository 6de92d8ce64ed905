"""Pairs of whatever is given: of images, or of a recording, which svdm_ros reads where it is installed. The one place
that knows of it."""
from __future__ import annotations

import importlib
from collections.abc import Sequence
from pathlib import Path

from .pair_folders import PairSource, find_pairs

_SUFFIXES = ('.mcap', '.db3', '.bag', '.zstd')
_READER = 'svdm_ros.bags.process.recorded_pairs'


def pair_sources(
    places: Sequence[Path], topics: tuple[str | None, str | None], calibration: Sequence[Path] | None
) -> Sequence[PairSource]:
    """Those of a recording, of a folder, or of two images. topics, calibration: as of `recorded_pairs`, and for a
    recording only. ValueError where there are none, ImportError without svdm_ros."""
    place = places[0]
    if len(places) == 1 and place.exists() and is_recording(place):
        return [recorded_pairs(place, topics, calibration)]
    if any(topics) or calibration:
        raise ValueError(f'{place}: it is no recording, for which --left, --right and --calib are')
    return find_pairs(places)


def is_recording(path: Path) -> bool:
    """Whether it is named like a file of a recording, or is a folder with one in it."""
    if not path.is_dir():
        return path.suffix in _SUFFIXES
    return any(file.suffix in _SUFFIXES for file in path.iterdir())


def recorded_pairs(
    path: Path, topics: tuple[str | None, str | None], calibration: Sequence[Path] | None
) -> PairSource:
    """The stereo pair of a recording. topics: of the left and right images, None where they are to be found.
    calibration: files, in place of camera_info. ValueError where there is none, ImportError without svdm_ros."""
    try:
        reader = importlib.import_module(_READER)
    except ModuleNotFoundError as error:
        if (error.name or '').partition('.')[0] != _READER.partition('.')[0]:
            raise
        raise ImportError(f'{path}: recordings are read by svdm_ros, which is not installed: give a folder of images, '
                          'or install svdm_ros') from None
    source: PairSource = reader.RecordedPairs(path, topics, calibration)
    return source
