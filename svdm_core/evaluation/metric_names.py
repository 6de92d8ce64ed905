"""What is known of a metric by its name: unit, digits, which of two values is better; and which a benchmark shows."""
from __future__ import annotations

from collections.abc import Sequence

from .metrics import METRICS
from .scene_evaluation import SCENE_METRICS

OF_THE_MAP = ('streaks', 'time_ms')
"""Figures that are of no region."""

REGION_TITLES = {'nonocc': 'visible pixels (nonocc)', 'all': 'all pixels (all)'}


def unit(metric: str) -> str:
    """px, % or ms."""
    if metric == 'time_ms':
        return 'ms'
    return '%' if metric.startswith(('bad', 'density', 'valid', 'kept', 'streaks')) else 'px'


def written(metric: str, value: float) -> str:
    """The value with as many digits as its unit is worth."""
    digits = 2 if metric == 'streaks' else {'px': 2, '%': 1, 'ms': 0}[unit(metric)]
    return f'{value:.{digits}f}'


def larger_is_better(metric: str) -> bool:
    """Of shares of pixels with an answer; all others are errors, or time."""
    return metric in ('density', 'valid', 'kept')


def default_metrics(layout: str) -> list[str]:
    """The columns of the layout's own benchmark: bad3 is KITTI's, bad0.5 and bad4 Middlebury's."""
    others = {'bad3'} if layout == 'Middlebury' else {'bad0.5', 'bad4'}
    return [metric for metric in METRICS if metric not in others]


def check_metrics(names: Sequence[str]) -> None:
    """ValueError names one there is not."""
    for name in names:
        if name not in SCENE_METRICS:
            raise ValueError(f'metric {name!r} is not allowed: it must be {" | ".join(SCENE_METRICS)}')
