"""Writes image files of a stereo pair and their calibration as a rosbag2."""
from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from svdm_core.shown import line

from ...calibration.calibration_files import COLOUR_FOLDERS, read_calibration
from ...calibration.stereo_calibration import Rectifier, SideName, Size, StereoCalibration
from ...command_line.command import progress
from ..writing.new_bag import add_topic, check_bag_output, new_bag
from ..writing.output_place import check_apart
from ..writing.stereo_messages import (
    CAMERA_INFO,
    DISPARITY_IMAGE,
    IMAGE,
    Moment,
    camera_info_bytes,
    encoding_of,
    ground_truth_bytes,
    image_bytes,
)
from .ground_truth import read_truth, truth_files
from .image_files import FilePair, find_pairs, read_pixels

FRAME = 'camera_left_optical'
"""Of both sides, as the right P matrix tells where the right camera is in the frame of the left one."""
GROUND_TRUTH = '/ground_truth/disparity'
_SIDES: tuple[SideName, ...] = ('left', 'right')


def run(options: argparse.Namespace) -> int:
    """Write the bag and say what was written; the exit code 0 or 1. ValueError or OSError with one line."""
    check_apart(options.output, [*filter(None, (options.left, options.right, options.ground_truth)), *options.calib])
    check_bag_output(options.output, options.force)
    found = find_pairs(options.left, options.right, options.rate)
    first = read_pixels(found.pairs[0].left)
    calibration = read_calibration(options.calib, _of_colour_cameras(options.left, first))
    reader = PairReader(calibration, (first.shape[1], first.shape[0]), encoding_of(first))
    truths = _truths(options, calibration, found.pairs)
    with new_bag(options.output, options.storage, options.compression, options.force) as writer:
        topics = {topic: add_topic(writer, topic, kind) for topic, kind in _topics(truths).items()}
        with progress('pairs', len(found.pairs)) as advance:
            for pair in found.pairs:
                for topic, message in _messages(pair, reader, truths):
                    writer.write(topics[topic], pair.stamp, message)
                advance()
    print(_summary(options.output, len(found.pairs), reader, found.stamps_from, len(truths)))
    for path in found.unpaired:
        print(f'images_to_bag: left out: {line(path)} has no partner of its name on the other side', file=sys.stderr)
    return 1 if found.unpaired else 0


class PairReader:
    """Reads images of one size and encoding, and rectifies those that are not.

    Raises ValueError where the calibration does not belong to images of `size` (width, height in px).
    """

    def __init__(self, calibration: StereoCalibration, size: Size, encoding: str) -> None:
        self.calibration = calibration.scaled(size)
        self.size, self.encoding = size, encoding
        self._rectifiers = {} if calibration.is_rectified else {
            side: Rectifier(self.calibration.camera(side)) for side in _SIDES}

    @property
    def rectifies(self) -> bool:
        """Whether the images come out other than they are in their files."""
        return bool(self._rectifiers)

    def read(self, path: Path, side: SideName) -> NDArray[Any]:
        """The rectified pixels. ValueError where size or encoding are not those of the first image."""
        pixels = read_pixels(path)
        size, encoding = (pixels.shape[1], pixels.shape[0]), encoding_of(pixels)
        if (size, encoding) != (self.size, self.encoding):
            raise ValueError(f'{path} has {size[0]}x{size[1]} px in {encoding}, the first left image '
                             f'{self.size[0]}x{self.size[1]} in {self.encoding}: all must be alike')
        return self._rectifiers[side](pixels) if self._rectifiers else pixels


def _of_colour_cameras(left: Path, first: NDArray[Any]) -> bool:
    """Of KITTI's two pairs of cameras, whether these images are of the colour one: as the folder says, or the pixels.
    """
    names = {part for part in left.resolve().parts if part.startswith('image_')}
    return bool(names & set(COLOUR_FOLDERS)) if names else first.ndim == 3


def _truths(
    options: argparse.Namespace, calibration: StereoCalibration, pairs: tuple[FilePair, ...]
) -> Mapping[Path, Path]:
    if options.ground_truth is None:
        return {}
    if not calibration.is_rectified:
        raise ValueError(f'--ground-truth {options.ground_truth} is not allowed with a calibration of '
                         f'{calibration.source}: these images get rectified, and the truth is of images that are')
    return truth_files(options.ground_truth, pairs)


def _topics(truths: Mapping[Path, Path]) -> dict[str, str]:
    topics = {f'/{side}/{name}': kind for side in _SIDES
              for name, kind in (('camera_info', CAMERA_INFO), ('image_rect', IMAGE))}
    return topics | ({GROUND_TRUTH: DISPARITY_IMAGE} if truths else {})


def _messages(pair: FilePair, reader: PairReader, truths: Mapping[Path, Path]) -> Iterator[tuple[str, bytes]]:
    """Topic and CDR of everything of one moment; the calibration comes before the images, for those who wait for it."""
    moment = Moment(pair.stamp, FRAME)
    for side in _SIDES:
        yield f'/{side}/camera_info', camera_info_bytes(reader.calibration.camera(side), moment)
    for side, path in (('left', pair.left), ('right', pair.right)):
        yield f'/{side}/image_rect', image_bytes(reader.read(path, side), moment)
    if pair.left in truths:
        truth = read_truth(truths[pair.left], reader.size)
        yield GROUND_TRUTH, ground_truth_bytes(truth, reader.calibration, moment)


def _summary(output: Path, pairs: int, reader: PairReader, stamps_from: str, truths: int) -> str:
    calibration = reader.calibration
    rectified = f', rectified here by the calibration of {calibration.source}' if reader.rectifies else ''
    truth = f', ground truth for {truths}' if truths else ''
    told = 'pair' if pairs == 1 else 'pairs'
    return (f'{output}: {pairs} {told} of {reader.size[0]}x{reader.size[1]} px in {reader.encoding}{rectified}{truth}; '
            f'f {calibration.focal_length:g} px, baseline {calibration.baseline:g} m; stamps from {stamps_from}')
