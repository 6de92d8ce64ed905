"""Pictures of a study, as bytes: error over parameter, and disparity maps with their streaks."""
from __future__ import annotations

import io
from collections.abc import Sequence
from typing import Any

import cv2
import numpy as np
from matplotlib.figure import Figure

from ..evaluation.paper import PaperStudyTable
from ..evaluation.streaks import streak_mask
from ..kernels.arrays import Float32, Image, Uint8
from .optimization import Evaluation, Step

MAP_WIDTH = 360  # px
_RED = (40, 40, 255)


def draw_step(step: Step, table: PaperStudyTable | None) -> bytes:
    """A PNG of three plots over the values of a step: avgerr with the paper's, bad2 and bad4, streaks."""
    numeric = step.range.numeric
    values: list[Any] = list(step.range.values) if numeric else [str(value) for value in step.range.values]
    figure = Figure(figsize=(11, 3.2), layout='constrained')
    error, bad, streaks = figure.subplots(1, 3)
    if table is not None:
        error.plot(values, table.nonocc, 's--', color='tab:blue', alpha=0.5, markersize=3, label='the paper, nonocc')
        error.plot(values, table.everywhere, 's--', color='tab:red', alpha=0.5, markersize=3, label='the paper, all')
    for ax, names, unit in ((error, ('avgerr',), 'avgerr (px)'), (bad, ('bad2', 'bad4'), 'bad pixels (%)')):
        for name in names:
            for region, colour in (('nonocc', 'tab:blue'), ('all', 'tab:red')):
                ax.plot(values, _curve(step.evaluations, f'{name}_{region}'), 'o-' if name != 'bad4' else '^-',
                        color=colour, markersize=4, label=f'{name}, {region}')
        ax.set_ylabel(unit)
    shares = _curve(step.evaluations, 'streaks')
    streaks.plot(values, shares, 'o-', color='tab:green', markersize=4)
    streaks.set(ylabel='streaks (%)', ylim=(0, 1.1 * max(shares) or 1))
    for ax in (error, bad, streaks):
        ax.set_xlabel(step.range.name)
        ax.grid(alpha=0.3)
        if numeric:
            ax.axvline(float(step.best_value), color='black', linewidth=0.8)
    for ax in (error, bad):
        low, high = ax.get_ylim()
        ax.set_ylim(low, high + 0.25 * (high - low))
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


def draw_map(disparity: Float32, image: Image, num_disparities: int) -> bytes:
    """A JPEG of a disparity map in grey, nearer is brighter, its streaks red; MAP_WIDTH px wide."""
    shades = np.clip(disparity * (255 / num_disparities), 0, 255).astype(np.uint8)
    picture: Uint8 = np.ascontiguousarray(np.repeat(shades[..., None], 3, axis=2))
    picture[streak_mask(disparity, image)] = _RED
    return _jpeg(picture)


def draw_image(image: Image) -> bytes:
    """A JPEG of the left image, as wide as the maps."""
    return _jpeg(image)


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
