"""A matcher that keeps what stages 1 to 3 gave, so that only stage 4 runs where only its parameters changed."""
from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np

from ..disparity_refinement.left_right import left_right_check
from ..disparity_refinement.refinement import refine
from ..kernels.arrays import Bool, Float32, Image, Int32
from ..matcher import StereoMatcher
from ..parameters import MatcherParameters, parameter_table

_NAMES = [info.name for info in parameter_table()]  # in the order of the stages

STAGE_4 = frozenset(_NAMES[_NAMES.index('tau_lr'):])
"""The parameters of stage 4: the left-right check, and what comes behind it."""


@dataclasses.dataclass(frozen=True, slots=True)
class _Stage3:
    parameters: dict[str, Any]
    winner: Int32
    vertex: Float32


class StageReuse:
    """Disparities of named pairs, under parameters that change. For one thread, with no other matcher at work."""

    def __init__(self, threads: int = 0) -> None:
        """threads: as of StereoMatcher."""
        self._matcher = _Recorder(threads=threads)
        self._kept: dict[str, _Stage3] = {}

    def disparity(self, name: str, left: Image, right: Image, parameters: MatcherParameters) -> Float32:
        """float32 (H, W), px: what StereoMatcher.compute gives. A name always stands for the same images."""
        early = {key: value for key, value in parameters.as_dict().items() if key not in STAGE_4}
        kept = self._kept.get(name)
        if kept is not None and kept.parameters == early:
            return _stage_4(kept, left, parameters)
        self._matcher.parameters = parameters
        disparity = self._matcher.compute(left, right).disparity
        self._kept[name] = _Stage3(early, *self._matcher.recorded)
        return disparity


def _stage_4(kept: _Stage3, left: Image, parameters: MatcherParameters) -> Float32:
    valid: Bool = left_right_check(kept.winner[0], kept.winner[1], parameters.min_disparity, parameters.tau_lr)
    vertex = kept.vertex if parameters.subpixel else None
    return refine(kept.winner[0], vertex, valid, np.require(left, requirements=('C', 'W')), parameters)


class _Recorder(StereoMatcher):
    """Remembers the winners of both views and the left view's sub-pixel offsets of the last pair."""

    recorded: tuple[Int32, Float32]

    def _along_trees(self, *arguments: Any) -> tuple[Int32, Float32]:
        return self._recorded(*super()._along_trees(*arguments))

    def _in_boxes(self, *arguments: Any) -> tuple[Int32, Float32]:
        return self._recorded(*super()._in_boxes(*arguments))

    def _recorded(self, winner: Int32, vertex: Float32) -> tuple[Int32, Float32]:
        self.recorded = winner.copy(), vertex.copy()
        return winner, vertex
