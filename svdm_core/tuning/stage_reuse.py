"""A matcher that keeps what stages 1 to 3 gave, so that only stage 4 runs where only its parameters changed."""
from __future__ import annotations

from ..kernels.arrays import Image
from ..matcher import DisparityResult, MatchedPair, StereoMatcher
from ..parameters import MatcherParameters


class StageReuse:
    """What comes of named pairs, under parameters that change. For one thread, with no other matcher at work."""

    def __init__(self, threads: int = 0) -> None:
        """threads: as of StereoMatcher."""
        self._matcher = StereoMatcher(threads=threads)
        self._kept: dict[str, MatchedPair] = {}

    def result(self, name: str, left: Image, right: Image, parameters: MatcherParameters) -> DisparityResult:
        """What StereoMatcher.compute gives. A name always stands for the same images."""
        self._matcher.parameters = parameters
        kept = self._kept.get(name)
        if kept is None or kept.outdated_by(parameters):
            kept = self._kept[name] = self._matcher.match(left, right)
        return self._matcher.refine(kept)
