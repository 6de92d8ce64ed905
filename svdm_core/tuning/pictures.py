"""Pictures of a study, as bytes: error over parameter, and disparity maps with their streaks."""
from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from ..evaluation.paper import PaperStudyTable
from ..evaluation.reconstruction import grey_levels
from ..evaluation.streaks import streak_mask
from ..kernels.arrays import Float32, Image, Uint8
from .image_pair import AnyPair
from .importance import Importance
from .optimization import Evaluation, Step

MAP_WIDTH = 360  # px
_RED = (40, 40, 255)


def draw_step(step: Step, plots: Sequence[tuple[str, Sequence[str]]], table: PaperStudyTable | None) -> bytes:
    """A PNG of plots over the values of a step, each with a label and its figures; the paper's avgerr in the first."""
    numeric = step.range.numeric
    pairs = list(zip(step.range.values, step.evaluations, strict=True))
    if numeric:
        pairs.sort(key=lambda pair: float(pair[0]))
    values: list[Any] = [value if numeric else str(value) for value, _ in pairs]
    evaluations = [evaluation for _, evaluation in pairs]
    figure = Figure(figsize=(11, 3.2), layout='constrained')
    axes = figure.subplots(1, len(plots))
    if table is not None:
        for theirs, colour, region in ((table.nonocc, 'tab:blue', 'nonocc'), (table.everywhere, 'tab:red', 'all')):
            axes[0].plot(values, theirs, 's--', color=colour, alpha=0.5, markersize=3, label=f'the paper, {region}')
    for ax, (label, names) in zip(axes, plots, strict=True):
        for number, name in enumerate(names):
            ax.plot(values, _curve(evaluations, name), '^-' if number > 1 else 'o-',
                    color=('tab:blue', 'tab:red')[number % 2], markersize=4, label=name.replace('_', ', '))
        low, high = ax.get_ylim()
        ax.set(xlabel=step.range.name, ylabel=label, ylim=(low, high + 0.25 * (high - low)))
        ax.grid(alpha=0.3)
        if numeric:
            ax.axvline(float(step.best_value), color='black', linewidth=0.8)
        if len(ax.lines) > 1 + numeric:
            ax.legend(fontsize=7, ncols=2, loc='upper center')
    return _png(figure)


def draw_trials(trials: Sequence[Evaluation], varied: Sequence[str], objective: str) -> bytes:
    """A PNG: the figure `objective` of all trials over each parameter varied, later trials darker."""
    columns = min(4, len(varied))
    rows = -(-len(varied) // columns)
    figure = Figure(figsize=(11, 2.8 * rows), layout='constrained')
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    results = [trial.average[objective] for trial in trials]
    for ax, name in zip(axes, varied, strict=False):  # the last row may not be full
        values = [getattr(trial.parameters, name) for trial in trials]
        ax.scatter([value if type(value) in (int, float) else str(value) for value in values], results,
                   c=range(len(trials)), cmap='Blues', vmin=-len(trials), s=14)
        ax.set(xlabel=name, ylabel=objective)
        ax.grid(alpha=0.3)
    for ax in axes[len(varied):]:
        ax.set_visible(False)
    return _png(figure)


def draw_importances(importances: Sequence[Importance], heading: str) -> bytes:
    """A PNG of bars, the largest above: by how much each parameter moves the objective."""
    figure = Figure(figsize=(11, 0.6 + 0.26 * len(importances)), layout='constrained')
    ax = figure.subplots()
    ax.barh([entry.name for entry in importances], [entry.spread for entry in importances], color='tab:blue')
    ax.barh([entry.name for entry in importances], [-entry.gain for entry in importances], color='tab:green')
    ax.invert_yaxis()
    ax.axvline(0, color='black', linewidth=0.8)
    ax.set_xlabel(f'{heading}: blue, by how much the worst value is above the best; green, by how much the best is '
                  'below the start')
    ax.grid(alpha=0.3, axis='x')
    return _png(figure)


def draw_map(disparity: Float32, scene: AnyPair) -> bytes:
    """A JPEG of a disparity map in grey, nearer is brighter, its streaks red; MAP_WIDTH px wide."""
    scale = 255 / scene.num_disparities
    shades = np.clip((disparity - scene.min_disparity) * scale, 0, 255).astype(np.uint8)
    picture: Uint8 = np.ascontiguousarray(np.repeat(shades[..., None], 3, axis=2))
    picture[streak_mask(disparity, grey_levels(scene.left, scene.right)[0])] = _RED
    return _jpeg(picture)


def draw_image(image: Image) -> bytes:
    """A JPEG of the left image, as wide as the maps; 16 bits are stretched."""
    return _jpeg(grey_levels(image, image)[0])


def _jpeg(picture: Image) -> bytes:
    height = round(picture.shape[0] * MAP_WIDTH / picture.shape[1])
    small = cv2.resize(picture, (MAP_WIDTH, height), interpolation=cv2.INTER_AREA)
    return bytes(cv2.imencode('.jpg', small, [cv2.IMWRITE_JPEG_QUALITY, 80])[1])


def _curve(evaluations: Sequence[Evaluation], name: str) -> list[float]:
    return [evaluation.average[name] for evaluation in evaluations]


def _png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', dpi=100)
    return buffer.getvalue()
