"""One pair of image messages to a matched frame: convert, check, prepare, match, filter."""
from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from svdm_core import DisparityResult, StereoMatcher

from ..calibration.geometry import stereo_geometry
from .filtering import known_pixels
from .image_conversion import image_to_array
from .matched_frame import MatchedFrame
from .preparation import PreparedPair, prepare, search_range
from .row_offsets import RectificationCheck

if TYPE_CHECKING:
    from numpy.typing import NDArray
    from sensor_msgs.msg import CameraInfo, Image

    from ..node.parameter_set import NodeParameters

    Pixels = NDArray[np.uint8] | NDArray[np.uint16]


@dataclasses.dataclass(frozen=True, slots=True)
class StereoFrame:
    """What one computation starts from; `arrived` is the monotonic time (s) of the later image."""

    left: Image
    right: Image
    left_info: CameraInfo | None
    right_info: CameraInfo | None
    arrived: float


@dataclasses.dataclass(frozen=True, slots=True)
class ProcessedFrame:
    """What came of a pair, the milliseconds a stage, and what is wrong with the camera_info (empty: nothing)."""

    frame: MatchedFrame
    timings: dict[str, float]
    geometry_problem: str


class FrameError(ValueError):
    """A pair that cannot be matched. `reason` is the short name it is counted under; the text says what to do."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason


class FrameProcessor:
    """Holds the matcher. Everything here must be called from one and the same thread; messages of any library.

    rectification: what it found may be read from any thread.
    """

    def __init__(self, on_compiling: Callable[[str], None] = lambda _: None) -> None:
        """on_compiling: told before a frame that has to compile kernels first, with what they are for."""
        self._on_compiling = on_compiling
        self._matcher: StereoMatcher | None = None
        self._threads = 0
        self.rectification = RectificationCheck()

    def warm_up(self, parameters: NodeParameters) -> None:
        """Compile what `parameters` need for 8-bit images, or load it from the cache of an earlier run."""
        self._matcher_for(parameters).warm_up([np.uint8])

    def process(self, frame: StereoFrame, parameters: NodeParameters) -> ProcessedFrame:
        """Match one pair with `parameters`. Raises FrameError for anything that is wrong with the pair."""
        left, right = _pixels(frame.left, 'left'), _pixels(frame.right, 'right')
        _check_alike(frame, left, right)
        height, width = left.shape[:2]
        whole = stereo_geometry(frame.left_info, frame.right_info, width, height, parameters.baseline)
        try:
            pair = prepare(left, right, whole, parameters)
        except ValueError as error:
            raise FrameError('not prepared', f'pair dropped: {error}') from error
        matching, problem = search_range(pair.geometry, parameters)
        parameters = dataclasses.replace(parameters, matcher=matching)
        searched = (matching.min_disparity, matching.min_disparity + matching.num_disparities - 1)
        self.rectification.look(pair.left, pair.right, searched, frame.arrived)
        result = self._match(pair, parameters)
        known = known_pixels(result, pair.geometry, parameters)
        matched = MatchedFrame(frame.left.header, pair.left, result.disparity, result.valid, known, result.step,
                               pair.geometry, parameters)
        return ProcessedFrame(matched, result.timings, '; '.join(filter(None, (whole.problem, problem))))

    def _match(self, pair: PreparedPair, parameters: NodeParameters) -> DisparityResult:
        matcher = self._matcher_for(parameters)
        lacking = matcher.not_compiled(pair.left)
        if lacking:
            self._on_compiling(lacking)
        try:
            return matcher.compute(pair.left, pair.right)
        except ValueError as error:
            raise FrameError('refused', f'pair dropped, the matcher refuses it: {error}') from error

    def _matcher_for(self, parameters: NodeParameters) -> StereoMatcher:
        if self._matcher is None or self._threads != parameters.num_threads:
            self._matcher = StereoMatcher(parameters.matcher, parameters.num_threads)
            self._threads = parameters.num_threads
        self._matcher.parameters = parameters.matcher
        return self._matcher


def _pixels(image: Image, side: str) -> Pixels:
    try:
        return image_to_array(image)
    except ValueError as error:
        raise FrameError('unreadable', f'{side} image dropped: {error}') from error


def _check_alike(frame: StereoFrame, left: Pixels, right: Pixels) -> None:
    if left.shape[:2] != right.shape[:2]:
        raise FrameError(
            'sizes differ',
            f'pair dropped: the left image has {_size(frame.left)} px, the right {_size(frame.right)}: '
            'rectify both to the same size',
        )
    if left.shape != right.shape or left.dtype != right.dtype:
        raise FrameError(
            'encodings differ',
            f'pair dropped: the left image is {frame.left.encoding}, the right {frame.right.encoding}: '
            'publish both in the same encoding',
        )


def _size(image: Image) -> str:
    return f'{image.width}x{image.height}'
