"""Pictures of confidences: precision-coverage curves and the reliability diagram. Needs matplotlib."""
from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from .trust_report import THRESHOLDS

_MARKERS = 'os^vDP'


def draw_trust(methods: Mapping[str, Any], region: str) -> bytes:
    """A PNG: for each threshold what is wrong of what is kept, and predicted against observed chances.

    methods: name -> its part of the document that --json writes. region: of `REGIONS`.
    """
    figure = Figure(figsize=(12, 3.7), layout='constrained')
    *curves, diagram = figure.subplots(1, len(THRESHOLDS) + 1)
    for ax, threshold in zip(curves, THRESHOLDS, strict=True):
        _draw_curves(ax, {name: method['confidence'][region][f'wrong_by_{threshold}px']
                          for name, method in methods.items()})
        ax.set(xlabel='kept (% of the pixels, surest first)', ylabel=f'off by more than {threshold} px (% of the kept)',
               xlim=(0, 102))
    curves[0].legend(fontsize=8, loc='upper left')
    _draw_reliability(diagram, {name: method['confidence'][region]['reliability'] for name, method in methods.items()
                                if 'reliability' in method['confidence'][region]})
    for ax in (*curves, diagram):
        ax.grid(alpha=0.3)
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', dpi=100)
    return buffer.getvalue()


def _draw_curves(ax: Axes, methods: Mapping[str, Any]) -> None:
    for number, (name, figures) in enumerate(methods.items()):
        colour, check = f'C{number}', figures['own_check']
        if 'wrong' in figures:
            ax.plot(figures['coverage'], figures['wrong'], color=colour, label=f'{name}, by confidence')
        ax.plot(check['kept'], check['wrong'], _MARKERS[number % len(_MARKERS)], color=colour,
                label=f'{name}, its own check')
    ax.set_ylim(bottom=0)


def _draw_reliability(ax: Axes, methods: Mapping[str, Any]) -> None:
    ax.plot([0, 1], [0, 1], color='black', linewidth=0.8)
    for number, (name, found) in enumerate(methods.items()):
        ax.scatter(found['predicted'], found['observed'], s=[20 + 400 * share for share in found['share']], alpha=0.6,
                   color=f'C{number}', label=f'{name}, error {found["calibration_error"]:.3f}')
    if methods:
        ax.legend(fontsize=8, loc='upper left')
    else:
        ax.text(0.5, 0.5, 'no method with a confidence', ha='center', va='center')
    ax.set(xlabel='predicted chance of being off by more than 1 px', ylabel='observed share', xlim=(0, 1), ylim=(0, 1),
           aspect='equal')
