"""The pairs of a recording as images, for `svdm check-rectification`."""
from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from numpy.typing import NDArray

from ...calibration.calibration_files import read_calibration
from ...frames.frame_preparation import FramePreparation
from ...frames.views import FrameError
from ...node.parameter_set import NodeParameters
from ..reading.pair_stream import PairStream
from ..reading.recording import RecordingError, open_recording
from ..reading.stereo_topics import find_stereo_topics
from ..writing.stereo_messages import infos_of
from .row_estimate import stereo_frame, unrectified_lines

_CLOSE_NS = 5_000_000
"""Largest difference of the stamps of a pair."""


class RecordedPairs:
    """The stereo pair of a recording; what is found is said in `notes` once it is read."""

    num_disparities: int | None = None

    def __init__(
        self, path: Path, topics: tuple[str | None, str | None], calibration: Sequence[Path] | None
    ) -> None:
        """topics: of the left and right images, None where they are to be found. calibration: files in place of
        camera_info. Raises ValueError."""
        self.name = path.absolute().name
        self.notes: list[str] = []
        self._path, self._topics = path, topics
        self._infos = infos_of(read_calibration(calibration, colour=False)) if calibration else None

    def read(self, most: int) -> Iterator[tuple[NDArray[Any], NDArray[Any]]]:
        """Up to `most` pairs, evenly over the time, rectified where camera_info says that they are raw. Raises
        RecordingError where there are none."""
        preparation, parameters = FramePreparation(), NodeParameters()
        told: dict[str, None] = {}
        found = 0
        with open_recording(self._path) as recording:
            try:
                topics = find_stereo_topics(recording.topics, *self._topics)
            except RecordingError as error:
                raise RecordingError(f'{self._path}: {error}') from None
            stream = PairStream(recording, topics, _CLOSE_NS, copied=frozenset(), start_ns=recording.start_ns,
                                stop_ns=recording.end_ns, infos=self._infos)
            for pair in stream.sampled(most):
                is_raw = any(unrectified_lines(pair, topics))
                try:
                    prepared = preparation.of(stereo_frame(pair, is_raw), parameters)
                except FrameError as error:
                    told[f'{self.name}: {error}'] = None
                    continue
                if is_raw:
                    told[f'{self.name}: the images are rectified by camera_info first'] = None
                found += 1
                yield prepared.pair.left, prepared.pair.right
        self.notes = list(told)
        if not found:
            raise RecordingError('; '.join(self.notes) or f'{self._path}: no pair among the images on {topics.left} '
                                                          f'and {topics.right}')
