"""What makes one disparity map better than another: ground truth where it is known, else the images themselves."""
from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, Protocol

from ..evaluation.datasets import MIDDLEBURY_WEIGHTS, StereoScene
from ..evaluation.metrics import error_metrics
from ..evaluation.reconstruction import grey_levels, reconstruction
from ..evaluation.streaks import streak_share
from ..matcher import DisparityResult
from .consensus import Consensus, disagreement
from .image_pair import AnyPair


class Judge(Protocol):
    """headings: figure -> its heading with unit; smaller is better. plots: label and figures of each. weights: share of
    a pair in the average, 1 where it is not named. resolution: differences of the objective below that say nothing.
    explanation: of the figures, for a page. name: with everything that the figures follow from besides map and pair."""

    @property
    def headings(self) -> Mapping[str, str]: ...
    @property
    def plots(self) -> tuple[tuple[str, tuple[str, ...]], ...]: ...
    @property
    def weights(self) -> Mapping[str, float]: ...
    @property
    def resolution(self) -> float: ...
    @property
    def explanation(self) -> str: ...
    @property
    def name(self) -> str: ...

    def figures(self, result: DisparityResult, pair: Any) -> dict[str, float]:
        """Of what came of a pair. ValueError where one is not a number."""
        ...


class TruthJudge:
    """Errors against the ground truth of a StereoScene, and streaks."""

    headings: Mapping[str, str] = {
        'avgerr_nonocc': 'avgerr nonocc px', 'avgerr_all': 'avgerr all px', 'bad2_nonocc': 'bad2 nonocc %',
        'bad2_all': 'bad2 all %', 'bad4_nonocc': 'bad4 nonocc %', 'bad4_all': 'bad4 all %', 'streaks': 'streaks %'}
    plots = (('avgerr (px)', ('avgerr_nonocc', 'avgerr_all')),
             ('bad pixels (%)', ('bad2_nonocc', 'bad2_all', 'bad4_nonocc', 'bad4_all')), ('streaks (%)', ('streaks',)))
    weights: Mapping[str, float] = MIDDLEBURY_WEIGHTS
    resolution = 0.0
    explanation = 'Errors are in px of the full resolution, averaged with the weights of Middlebury v3.'

    def __init__(self, factor: float) -> None:
        """factor: full-resolution px per px of the images."""
        self._factor = factor

    @property
    def name(self) -> str:
        return f'truth {self._factor}'

    def figures(self, result: DisparityResult, pair: StereoScene) -> dict[str, float]:
        nonocc = error_metrics(result.disparity, pair.ground_truth, pair.nonocc, self._factor)
        everywhere = error_metrics(result.disparity, pair.ground_truth, None, self._factor)
        figures = {f'{name}_{region}': values[name] for name in ('avgerr', 'bad2', 'bad4')
                   for region, values in (('nonocc', nonocc), ('all', everywhere))}
        figures['streaks'] = streak_share(result.disparity, pair.left)
        for name, value in figures.items():
            if not math.isfinite(value):
                raise ValueError(f'scene {pair.name}: {name} is {value}: its mask has no pixel with known ground truth')
        return figures


JUMP_WEIGHT, DISAGREEMENT_WEIGHT = 0.8, 2.0
"""In the loss. Without jumps, maps that copy the noise of the images win; without disagreement, smooth ones that are
far off where there is little texture."""


class UnsupervisedJudge:
    """loss = mismatch + 0.8 jumps + 2 disagreement, all in %: how badly a map explains its pair (`reconstruction`), and
    how far it is from what good settings agree on (`consensus`). `proof` tells what it is worth.

    Streaks and what is not valid are shown beside it, and are not what is made small: constant maps have neither.
    """

    headings: Mapping[str, str] = {
        'loss': 'loss %', 'mismatch': 'mismatch %', 'jumps': 'jumps %', 'disagreement': 'disagreement %',
        'streaks': 'streaks %', 'failed': 'not valid %'}
    plots = (('loss (%)', ('loss',)), ('its parts (%)', ('mismatch', 'jumps', 'disagreement')),
             ('beside it (%)', ('streaks', 'failed')))
    weights: Mapping[str, float] = {}
    resolution = 0.3
    explanation = (
        'There is no ground truth. The loss says how badly the maps explain the images they were made from, and how '
        'far they are from what good settings agree on: mismatch, by how much the right image, moved by the map, '
        'differs from the left one; jumps of the map where the image has none, which count 0.8; and disagreement with '
        'the median of four other maps, which counts 2. It finds the way from poor settings to good ones; among good '
        'ones it is a weak guide, and less than 0.3 says nothing. Streaks and what is not valid (left-right check, '
        'uniqueness) are shown beside it and are not made small: a constant map has neither.')
    name = 'unsupervised'

    def __init__(self, threads: int = 0) -> None:
        """threads: of the matcher that makes the consensus."""
        self._consensus = Consensus(threads)

    def figures(self, result: DisparityResult, pair: AnyPair) -> dict[str, float]:
        left, right = grey_levels(pair.left, pair.right)
        found = reconstruction(result.disparity, left, right)
        far = disagreement(result.disparity, self._consensus.of(pair), pair.num_disparities)
        return {'loss': found.mismatch + JUMP_WEIGHT * found.jumps + DISAGREEMENT_WEIGHT * far,
                'mismatch': found.mismatch, 'jumps': found.jumps, 'disagreement': far,
                'streaks': streak_share(result.disparity, left),
                'failed': 100 * (1 - float(result.valid.mean()))}
