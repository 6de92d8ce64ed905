"""A film, or pictures, of the disparities of a bag for the eye."""
from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from svdm_core.kernels.arrays import Uint8

from ...frames.colours import coloured
from ...frames.image_conversion import pixels_of
from ...frames.matched_frame import END_MARGIN
from ..reading.recorded_frames import stamp_ns
from ..reading.recording import open_recording
from ..writing.output_place import PREVIEW_FILE, PREVIEW_FOLDER
from .outputs import DISPARITY_TOPIC

KINDS = ('mp4', 'png')
_DEFAULT_RATE = 10.0
_CODEC = 'vp09'
"""VP9: browsers and players have it, and the wheels of OpenCV, which have no H.264."""


def write_preview(bag: Path, kind: str) -> None:
    """Write preview.mp4, or preview/STAMP.png a disparity, into the folder of a bag.

    The film is VP9 without the last column or row of odd sizes. Blue is the smallest disparity of the search range, red
    the largest, black invalid. Raises OSError where it cannot be written.
    """
    with open_recording(bag) as recording:
        topic = recording.topics[DISPARITY_TOPIC]
        messages = (recording.deserialize(message) for message in recording.messages([DISPARITY_TOPIC]))
        if kind == 'png':
            _write_pictures(messages, bag / PREVIEW_FOLDER)
        else:
            seconds = (recording.end_ns - recording.start_ns) / 1e9
            _write_film(messages, bag / PREVIEW_FILE, topic.count / seconds if topic.count > 1 else _DEFAULT_RATE)


def picture(disparity: Any) -> Uint8:
    """A stereo_msgs/DisparityImage in colours, uint8 BGR (H, W, 3)."""
    low, high = disparity.min_disparity + END_MARGIN, disparity.max_disparity - END_MARGIN
    return coloured(pixels_of(disparity.image), low, high)


def _write_pictures(messages: Iterator[Any], folder: Path) -> None:
    folder.mkdir()
    for message in messages:
        path = folder / f'{stamp_ns(message)}.png'
        path.write_bytes(cv2.imencode('.png', picture(message))[1].tobytes())


def _write_film(messages: Iterator[Any], path: Path, rate: float) -> None:
    writer = None
    for message in messages:
        frame = picture(message)
        if writer is None:
            size = frame.shape[1], frame.shape[0]
            writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*_CODEC), rate, size)
            if not writer.isOpened():
                raise OSError(0, 'OpenCV has no encoder for VP9 here: take --preview png', str(path))
        writer.write(frame if frame.shape[1::-1] == size else np.asarray(cv2.resize(frame, size), np.uint8))
    if writer is not None:
        writer.release()
