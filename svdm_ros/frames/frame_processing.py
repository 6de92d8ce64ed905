"""One pair of image messages to a matched frame: convert, check, prepare, match, filter."""
from __future__ import annotations

import dataclasses
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np

from svdm_core import DisparityResult, NotEnoughMemoryError, RowAlignment, StereoMatcher
from svdm_core.memory import is_out_of_memory, lacking_text

from .filtering import filled_or_valid, nothing_left
from .frame_preparation import FramePreparation, PreparedFrame
from .matched_frame import MatchedFrame
from .preparation import PreparedPair, beyond_reach
from .temporal_filter import TemporalFilter
from .views import FrameError, StereoFrame

if TYPE_CHECKING:
    from ..node.parameter_set import NodeParameters


RowSource = Callable[[PreparedFrame], RowAlignment | None]
"""By what the right image of a pair is aligned; None: as it is."""


@dataclasses.dataclass(frozen=True, slots=True)
class ProcessedFrame:
    """What came of a pair, the milliseconds a stage, and why it may be wrong: camera_info, search range, exposure, or
    nothing that is known (empty: all is well). hint: what cannot be found with these settings, if it is there."""

    frame: MatchedFrame
    timings: dict[str, float]
    problem: str
    hint: str = ''


class FrameProcessor:
    """Holds the matcher. Everything here must be called from one and the same thread; messages of any library."""

    def __init__(
        self, on_compiling: Callable[[str], None] = lambda _: None, rows: RowSource | None = None
    ) -> None:
        """on_compiling: told before a frame that has to compile kernels first, with what they are for. rows: shown each
        pair before it is matched; says by what its right image is aligned.
        """
        self._on_compiling = on_compiling
        self._matcher: StereoMatcher | None = None
        self._threads = 0
        self._preparation = FramePreparation()
        self._temporal = TemporalFilter()
        self._rows = rows

    def warm_up(self, parameters: NodeParameters) -> None:
        """Compile what `parameters` need for 8-bit images, or load it from the cache of an earlier run."""
        self._matcher_for(parameters).warm_up([np.uint8])

    def process(self, frame: StereoFrame, parameters: NodeParameters) -> ProcessedFrame:
        """Match one pair with `parameters`. Raises FrameError for anything that is wrong with the pair,
        NotEnoughMemoryError."""
        try:
            return self._processed(frame, parameters)
        except Exception as error:
            if not is_out_of_memory(error):
                raise
            raise NotEnoughMemoryError(
                f'{lacking_text(error)}: set downscale, roi or fewer num_disparities') from None

    def _processed(self, frame: StereoFrame, parameters: NodeParameters) -> ProcessedFrame:
        prepared = self._preparation.of(frame, parameters)
        pair, parameters = prepared.pair, prepared.parameters
        result = self._match(pair, parameters, None if self._rows is None else self._rows(prepared))
        weight = parameters.temporal_filter
        setting = parameters.matcher, pair.geometry, parameters.region, parameters.downscale, frame.raw
        disparity = self._temporal(result.disparity, filled_or_valid(result.valid, parameters), weight, frame.arrived,
                                   setting)
        step = 0.0 if weight > 0 else result.step
        matched = MatchedFrame(frame.left.header, pair.left, disparity, result.valid, result.confidence, step,
                               pair.geometry, parameters)
        notes = prepared.whole.problem, prepared.problem, pair.note, nothing_left(matched)
        return ProcessedFrame(matched, result.timings, '; '.join(filter(None, notes)),
                              beyond_reach(pair.geometry, parameters.matcher.min_disparity))

    def _match(self, pair: PreparedPair, parameters: NodeParameters, rows: RowAlignment | None) -> DisparityResult:
        matcher = self._matcher_for(parameters)
        lacking = matcher.not_compiled(pair.left)
        if lacking:
            self._on_compiling(lacking)
        try:
            return matcher.compute(pair.left, pair.right, rows)
        except ValueError as error:
            raise FrameError('refused', f'pair dropped, the matcher refuses it: {error}') from error

    def _matcher_for(self, parameters: NodeParameters) -> StereoMatcher:
        if self._matcher is None or self._threads != parameters.num_threads:
            self._matcher = StereoMatcher(parameters.matcher, parameters.num_threads)
            self._threads = parameters.num_threads
        self._matcher.parameters = parameters.matcher
        return self._matcher
