"""The picture of a run: the scene, and disparity and error before and after the change of parameters."""
from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from numpy.typing import NDArray

matplotlib.use('Agg')  # files only; no display is needed
from matplotlib import pyplot as pyplot
from matplotlib.axes import Axes

from ..processes.scene import NUM_DISPARITIES, Scene

ERROR_SHOWN = 8.0  # px; larger errors get the last colour
UNKNOWN = '0.55'  # grey
DOTS_PER_INCH = 120


def draw_comparison(
    path: Path, scene: Scene, before: NDArray[np.float32], after: NDArray[np.float32], summary: Mapping[str, Any]
) -> None:
    """Write the PNG. before, after: x_l - x_r in px, (H, W), NaN where invalid; summary: as in summary.json."""
    figure, axes = pyplot.subplots(2, 3, figsize=(17, 7.9), layout='constrained')
    (left, disparity_before, error_before), (truth, disparity_after, error_after) = axes
    figure.suptitle(_headline(summary), fontsize=14)

    left.imshow(scene.left[:, :, ::-1])
    left.set_title('What the left camera sees')
    _show_disparity(truth, scene.ground_truth, 'Ground truth (grey: unknown)')
    _show_disparity(disparity_before, before, f'Before: {_settings(summary, 0)}')
    shown = _show_disparity(disparity_after, after, f'After: {_settings(summary, 1)}')
    figure.colorbar(shown, ax=axes[:, 1], label='disparity (px); nearer is larger', aspect=40, pad=0.02)

    _show_error(error_before, before - scene.ground_truth, 'Error before', summary['before'])
    shown = _show_error(error_after, after - scene.ground_truth, 'Error after', summary['after'])
    figure.colorbar(shown, ax=axes[:, 2], label='error (px); grey: unknown', aspect=40, pad=0.02, extend='max')

    for ax in axes.flat:
        ax.set_xticks([])
        ax.set_yticks([])
    figure.savefig(path, dpi=DOTS_PER_INCH)
    pyplot.close(figure)


def _headline(summary: Mapping[str, Any]) -> str:
    before, after = summary['before']['avgerr'], summary['after']['avgerr']
    return (f'Disparity from a live stereo camera, parameters changed while the node runs: '
            f'mean error {before:.2f} px before, {after:.2f} px after ({100 * (after / before - 1):+.0f} %)')


def _settings(summary: Mapping[str, Any], index: int) -> str:
    return ', '.join(f'{name} {values[index]:g}' for name, values in summary['changed'].items())


def _show_disparity(ax: Axes, disparity: NDArray[np.float32], title: str) -> Any:
    ax.set_facecolor(UNKNOWN)
    ax.set_title(title)
    known = np.ma.masked_invalid(disparity)
    return ax.imshow(known, cmap='turbo', vmin=0, vmax=NUM_DISPARITIES, interpolation='nearest')


def _show_error(ax: Axes, difference: NDArray[np.float32], title: str, figures: Mapping[str, float]) -> Any:
    ax.set_facecolor(UNKNOWN)
    ax.set_title(f'{title}: {figures["bad2"]:.0f} % of the pixels are off by more than 2 px')
    error = np.ma.masked_invalid(np.abs(difference))
    return ax.imshow(error, cmap='inferno', vmin=0, vmax=ERROR_SHOWN, interpolation='nearest')
