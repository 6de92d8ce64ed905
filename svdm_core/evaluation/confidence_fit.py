"""The two constants of `chance_wrong`, fitted to scenes with ground truth, and how they do on scenes left out."""
from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ..shown import cut
from .trust_curves import Numbers, Tally, auc, calibration_error, pooled, reliability, wrong_at

SHOWN_COVERAGES = (100, 95, 90, 80, 65, 50)
"""%, of the tables."""

_ROUNDS = 50  # of Newton's method; five to eight are needed
_RIDGE = 1e-8  # keeps the constants finite where confidence and truth agree everywhere


class Constants(NamedTuple):
    """Of the chance 1 / (1 + exp(slope c - offset)) of being wrong."""

    slope: float
    offset: float

    def chance(self, confidence: Numbers) -> Numbers:
        """Of each confidence, 0 .. 1."""
        return _logistic(self.offset - self.slope * confidence)


def fit(tally: Tally) -> Constants:
    """Those of the greatest likelihood (logistic regression), by Newton's method with steps halved until they gain."""
    share, wrong = tally.pixels / tally.pixels.sum(), tally.wrong / tally.pixels.sum()
    features = np.stack([-tally.levels, np.ones_like(tally.levels)])

    def loss(theta: Numbers) -> float:
        logits = theta @ features
        return float(share @ np.logaddexp(0, logits) - wrong @ logits + _RIDGE / 2 * theta @ theta)

    theta = np.zeros(2)
    for _ in range(_ROUNDS):
        chance = _logistic(theta @ features)
        slope = features @ (share * chance - wrong) + _RIDGE * theta
        curvature = (features * (share * chance * (1 - chance))) @ features.T + _RIDGE * np.eye(2)
        step = np.linalg.solve(curvature, slope)
        while loss(theta - step) > loss(theta) and np.abs(step).max() > 1e-9:
            step = step / 2
        theta = theta - step
        if np.abs(step).max() < 1e-9:
            break
    return Constants(*map(float, theta))


def _logistic(logits: Numbers) -> Numbers:
    """1 / (1 + exp(-logits)) that does not overflow."""
    return np.asarray(np.exp(-np.logaddexp(0, -logits)))


def check_fit_scenes(count: int) -> None:
    """ValueError where they are too few for one to be left out."""
    if count < 2:
        raise ValueError(f'--fit-confidence needs two scenes or more, to leave one out: there are {count}')


def left_out_figures(scenes: Mapping[str, Tally]) -> dict[str, Any]:
    """The constants of all scenes, and how they do on each scene when it is left out of the fit. As --json has it.

    scenes: name -> its pixels; each scene counts alike. Raises ValueError where there are fewer than two.
    """
    check_fit_scenes(len(scenes))
    everything = fit(pooled(list(scenes.values())))
    constants = {left_out: fit(pooled([tally for name, tally in scenes.items() if name != left_out]))
                 for left_out in scenes}
    figures = {name: _scene_figures(tally, constants[name]) for name, tally in scenes.items()}
    aucs = {name: one['auc'] for name, one in figures.items() if one['auc'] is not None}
    worst = min(aucs, key=lambda name: aucs[name], default=None)
    found = reliability([(tally, constants[name].chance) for name, tally in scenes.items()])
    errors = [one['calibration_error'] for one in figures.values()]
    return {
        **everything._asdict(),
        'left_out': {
            'auc_mean': float(np.mean(list(aucs.values()))) if aucs else None,
            'auc_worst': None if worst is None else aucs[worst], 'auc_worst_scene': worst,
            'wrong': {coverage: float(np.mean([one['wrong'][coverage] for one in figures.values()]))
                      for coverage in map(str, SHOWN_COVERAGES)},
            'calibration_error': calibration_error(found),
            'calibration_error_of_a_scene': {'mean': float(np.mean(errors)), 'worst': max(errors)},
        },
        'scenes': figures,
    }


def fit_lines(figures: Mapping[str, Any]) -> list[str]:
    """The same for the terminal."""
    left_out = figures['left_out']
    wrong = ', '.join(f'{value:.1f} % at {coverage} %' for coverage, value in left_out['wrong'].items())
    lines = [f'chance of being off by more than 1 px of the images: 1 / (1 + exp({figures["slope"]:.3f} c - '
             f'{figures["offset"]:.3f})), c the confidence, all pixels of {len(figures["scenes"])} scenes',
             'on scenes left out of the fit:']
    if left_out['auc_mean'] is not None:
        lines.append(f'  AUC: mean {left_out["auc_mean"]:.3f}, worst {left_out["auc_worst"]:.3f} '
                     f'({cut(left_out["auc_worst_scene"])})')
    of_a_scene = left_out['calibration_error_of_a_scene']
    return [*lines, f'  wrong, of the surest pixels of each scene: {wrong}',
            f'  expected calibration error: {left_out["calibration_error"]:.3f} over all scenes; of one scene '
            f'{of_a_scene["mean"]:.3f} in the mean, {of_a_scene["worst"]:.3f} at worst']


def _scene_figures(tally: Tally, constants: Constants) -> dict[str, Any]:
    """Of a scene, under the constants that were fitted without it."""
    found, wrong = auc(tally), wrong_at(tally, SHOWN_COVERAGES).tolist()
    return {
        **constants._asdict(), 'auc': None if math.isnan(found) else found,
        'wrong': dict(zip(map(str, SHOWN_COVERAGES), wrong, strict=True)),
        'calibration_error': calibration_error(reliability([(tally, constants.chance)])),
    }
