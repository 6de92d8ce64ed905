"""The row alignment of a recording, from pairs that are spread over it."""
from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from typing import NamedTuple

from svdm_core import RowAlignment, estimate_row_alignment
from svdm_core.row_alignment.alignment import LARGEST_SIDE

from ...calibration.rectification import unrectified_line
from ...frames.frame_preparation import FramePreparation, PreparedFrame
from ...frames.views import FrameError, StereoFrame
from ...node.parameter_set import NodeParameters
from ..reading.pair_stream import PairStream, RecordedPair
from ..reading.recorded_frames import stamp_ns
from ..reading.stereo_topics import StereoTopics

_MOST_PAIRS = 20
_MOST_PIXELS = 100_000_000
"""Of all pairs that are in memory at a time."""


class RowEstimate(NamedTuple):
    """rows: the identity where there is nothing significant to correct; None where there are no pairs, or where `note`
    says why."""

    rows: RowAlignment | None
    note: str = ''


def estimate_rows(
    stream: PairStream, frame_of: Callable[[RecordedPair], StereoFrame], parameters: NodeParameters
) -> RowEstimate:
    """The row alignment of the pairs of `stream`, as they are matched with `parameters`.

    The same recording and parameters give the same. frame_of: a pair as it is processed.
    """
    preparation = FramePreparation()

    def prepared(most: int) -> Iterator[PreparedFrame]:
        for pair in stream.sampled(most):
            with contextlib.suppress(FrameError):  # told when its turn comes
                yield preparation.of(frame_of(pair), parameters)

    first = next(prepared(_MOST_PAIRS), None)
    if first is None:
        return RowEstimate(None)
    height, width = first.pair.left.shape[:2]
    if max(height, width) > LARGEST_SIDE:
        return RowEstimate(None, f'rows are not aligned: images of {width}x{height} px are too large for it, which may '
                                 f'have {LARGEST_SIDE} px a side')
    frames = list(prepared(max(1, min(_MOST_PAIRS, _MOST_PIXELS // (2 * height * width)))))
    if any(frame.row_setting != first.row_setting for frame in frames):
        return RowEstimate(None, 'rows are not aligned: the size of the images, or their camera_info, changes within '
                                 'the recording: process its parts by --start and --duration')
    pairs = [(frame.pair.left, frame.pair.right) for frame in frames]
    return RowEstimate(estimate_row_alignment(pairs, *first.search) or RowAlignment.identity(width, height))


def stereo_frame(pair: RecordedPair, raw: bool) -> StereoFrame:
    """A recorded pair as a frame; raw: it is to be rectified."""
    left = pair.left.message
    return StereoFrame(left, pair.right.message, pair.left_info, pair.right_info, stamp_ns(left) / 1e9, raw=raw)


def unrectified_lines(pair: RecordedPair, topics: StereoTopics) -> Iterator[str]:
    """What tells that images are not rectified."""
    for info, topic in ((pair.left_info, topics.left), (pair.right_info, topics.right)):
        if info is not None and (line := unrectified_line(info, topic)):
            yield line
