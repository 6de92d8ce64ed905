"""Pairs for the page: of two image files, of the demo, of a recording."""
from __future__ import annotations

import itertools
import sys
from collections.abc import Generator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from svdm_core.evaluation.pair_folders import CameraPairs
from svdm_core.files.images import read_image
from svdm_core.files.pfm import read_pfm
from svdm_core.kernels.arrays import Float32, Image

from ..frames.views import StereoFrame
from .local_source import FedPair

if TYPE_CHECKING:
    from ..bags.reading.pair_stream import RecordedPair

_AS_IT_IS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR
_FOLDER_PERIOD = 0.1
"""s from pair to pair of a folder."""
_CLOSE_NS = 5_000_000
"""Largest difference of the stamps of a pair."""


class _Stamp(NamedTuple):
    sec: int = 0
    nanosec: int = 0


class _Header(NamedTuple):
    stamp: _Stamp = _Stamp()
    frame_id: str = ''


class FileImage(NamedTuple):
    """The fields of sensor_msgs/Image, without ROS."""

    header: _Header
    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: NDArray[np.uint8]

    @classmethod
    def of(cls, pixels: Image) -> FileImage:
        """pixels: uint8 or uint16, (H, W) or (H, W, 3) BGR."""
        height, width = pixels.shape[:2]
        bits = 8 * pixels.dtype.itemsize
        data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
        encoding = f'mono{bits}' if pixels.ndim == 2 else f'bgr{bits}'
        return cls(_Header(), height, width, encoding, int(sys.byteorder == 'big'), data.size // height, data)


def still_pair(left: Image, right: Image, truth: Float32 | None) -> Generator[FedPair]:
    """The same pair without end."""
    images: tuple[Any, Any] = FileImage.of(left), FileImage.of(right)
    yield from itertools.repeat(FedPair(StereoFrame(images[0], images[1], None, None, 0.0), truth, 0.0))


def file_pair(left: Path, right: Path, truth: Path | None) -> Generator[FedPair]:
    """Of two image files; truth: a .pfm. ValueError or OSError names the file that cannot be read."""
    images = read_image(left, _AS_IT_IS), read_image(right, _AS_IT_IS)
    known = None if truth is None else read_pfm(truth)
    if known is not None and known.shape != images[0].shape[:2]:
        raise ValueError(f'{truth} has {known.shape[1]}x{known.shape[0]} px and {left} has {images[0].shape[1]}x'
                         f'{images[0].shape[0]}: give the true disparity of this left image')
    return still_pair(*images, known)


def folder_pairs(cameras: Sequence[CameraPairs]) -> Generator[FedPair]:
    """Those of all cameras one after the other, over and over. ValueError names a file that cannot be read."""
    for number in itertools.count():
        pairs = [pair for camera in cameras for pair in camera.files]
        left, right = (read_image(path, _AS_IT_IS) for path in pairs[number % len(pairs)])
        images: tuple[Any, Any] = FileImage.of(left), FileImage.of(right)
        now = number * _FOLDER_PERIOD
        yield FedPair(StereoFrame(images[0], images[1], None, None, now), None, now)


def demo_pair() -> Generator[FedPair]:
    """Motorcycle of Middlebury 2014, with its ground truth. ImportError without scikit-image."""
    from ..processes.scene import load_scene

    scene = load_scene()
    return still_pair(scene.left, scene.right, scene.ground_truth)


def recorded(
    path: Path, topics: tuple[str | None, str | None], calibration: Sequence[Path] | None
) -> Generator[FedPair]:
    """The pairs of a recording in order, over and over; rectified where camera_info says that they are raw.

    topics: of the left and right images, None where they are to be found. calibration: files in place of camera_info.
    Raises ValueError where there are none, where the recording is damaged, ImportError without rosbags.
    """
    from ..bags.process.row_estimate import stereo_frame, unrectified_lines
    from ..bags.reading.pair_stream import PairStream, RecordedPair
    from ..bags.reading.recording import RecordingError, open_recording
    from ..bags.reading.stereo_topics import find_stereo_topics
    from ..bags.writing.stereo_messages import infos_of
    from ..calibration.calibration_files import read_calibration

    infos = infos_of(read_calibration(calibration, colour=False)) if calibration else None
    with open_recording(path) as recording:
        found = find_stereo_topics(recording.topics, *topics)
        while True:
            stream = PairStream(recording, found, _CLOSE_NS, copied=frozenset(), start_ns=recording.start_ns,
                                stop_ns=recording.end_ns, infos=infos)
            pairs = 0
            for pair in stream:
                if isinstance(pair, RecordedPair):
                    pairs += 1
                    is_raw = any(unrectified_lines(pair, found))
                    yield FedPair(stereo_frame(pair, is_raw), _truth(pair), pair.time_ns / 1e9)
            if not pairs:
                raise RecordingError(f'{path}: no pair among the images on {found.left} and {found.right}')


def _truth(pair: RecordedPair) -> Float32 | None:
    """Of a recorded DisparityImage; None where that is none."""
    from ..frames.image_conversion import pixels_of

    message = pair.ground_truth
    if message is None:
        return None
    try:
        values = pixels_of(message.image)
    except ValueError:
        return None
    return np.where(values >= message.min_disparity, values, np.float32(np.nan))
