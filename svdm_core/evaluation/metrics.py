"""How good a disparity map is: the Middlebury v3 figures, and their official weighted average."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..kernels.arrays import Bool

BAD_THRESHOLDS = (0.5, 1.0, 2.0, 3.0, 4.0)  # 3 is KITTI's, the others Middlebury's
QUANTILES = (50, 90, 95, 99)
METRICS = ('avgerr', 'rms', *(f'bad{threshold:g}' for threshold in BAD_THRESHOLDS),
           *(f'a{percent}' for percent in QUANTILES), 'density')


def error_metrics(
    disparity: NDArray[np.floating],
    ground_truth: NDArray[np.floating],
    mask: Bool | None = None,
    scale: float = 1.0,
) -> dict[str, float]:
    """Error figures of `disparity` over the pixels of `mask` with known ground truth.

    disparity, ground_truth: (H, W), px of the images matched; ground truth is not finite where unknown,
    disparity where it gives no answer. mask: bool (H, W), all pixels when None. scale: full-resolution
    pixels per pixel of the images matched (4 for quarter resolution); errors are multiplied by it.

    Returns avgerr and rms (px), bad0.5 ... bad4 (% of pixels off by more; a pixel without an answer is
    bad), a50 ... a99 (px, error quantiles), density (% of pixels with an answer). avgerr, rms and the
    quantiles are over pixels with an answer. NaN where there is no pixel to judge.
    Raises ValueError when the shapes differ.
    """
    if disparity.shape != ground_truth.shape or (mask is not None and mask.shape != ground_truth.shape):
        sizes = [f'{a.shape}' for a in (disparity, ground_truth, mask) if a is not None]
        raise ValueError(f'disparity, ground truth and mask must have one shape, not {", ".join(sizes)}')
    known = np.isfinite(ground_truth) if mask is None else np.isfinite(ground_truth) & mask
    error = scale * np.abs(disparity[known].astype(np.float64) - ground_truth[known])
    answered = error[np.isfinite(error)]
    metrics = {
        'avgerr': _mean(answered),
        'rms': _mean(answered**2) ** 0.5,
        'density': 100 * _mean(np.isfinite(error)),
    }
    for threshold in BAD_THRESHOLDS:
        metrics[f'bad{threshold:g}'] = 100 * _mean(~(error <= threshold))
    for percent in QUANTILES:
        metrics[f'a{percent}'] = float(np.percentile(answered, percent)) if answered.size else float('nan')
    return metrics


def weighted_average(scenes: Mapping[str, Mapping[str, float]], weights: Mapping[str, float]) -> dict[str, float]:
    """Average of the scenes' metrics; a scene without an entry in `weights` (MIDDLEBURY_WEIGHTS) counts 1."""
    share = np.array([weights.get(name, 1.0) for name in scenes])
    names = next(iter(scenes.values()), {})
    values = {metric: [scene[metric] for scene in scenes.values()] for metric in names}
    return {metric: float(np.dot(value, share) / share.sum()) for metric, value in values.items()}


def _mean(values: NDArray[Any]) -> float:
    return float(values.mean()) if values.size else float('nan')
