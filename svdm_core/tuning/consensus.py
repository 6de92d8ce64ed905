"""What several good settings agree on: the nearest there is to a truth where none is known."""
from __future__ import annotations

import numpy as np

from ..kernels.arrays import Float32
from ..matcher import StereoMatcher
from ..parameters import MatcherParameters
from .image_pair import AnyPair, fitted

_SETS = ({'aggregation': 'box'}, {'gradient': 'magnitude'}, {'alpha': 0.0, 'tau_ad': 0.0},
         {'p1': 0.1, 'p2': 0.45, 'p2_edge': 0.0})
"""Changes of the defaults that err in different places: other support, other costs, other smoothing."""
_FAR = 0.25
"""Of the search range: a pixel that is as far off counts in full."""


class Consensus:
    """The median of their maps, pair by pair; computed when it is first asked for, and kept."""

    def __init__(self, threads: int = 0) -> None:
        """threads: as of StereoMatcher."""
        self._matcher = StereoMatcher(threads=threads)
        self._maps: dict[str, Float32] = {}

    def of(self, pair: AnyPair) -> Float32:
        """float32 (H, W), px. A name always stands for the same pair."""
        if pair.name not in self._maps:
            maps = []
            for changes in _SETS:
                self._matcher.parameters = fitted(MatcherParameters().replace(**changes), pair)
                maps.append(self._matcher.compute(pair.left, pair.right).disparity)
            self._maps[pair.name] = np.asarray(np.median(maps, axis=0), np.float32)
        return self._maps[pair.name]


def disagreement(disparity: Float32, consensus: Float32, num_disparities: int) -> float:
    """How far a map (H, W) is from the consensus, px both: the mean over the pixels, in % of a quarter of the search
    range, beyond which nothing counts more."""
    far = _FAR * num_disparities
    return 100 * float((np.minimum(np.abs(disparity - consensus), far) / far).mean(dtype=np.float64))
