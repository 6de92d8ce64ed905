"""A picture of the offsets that were measured and of the field that takes them away. Needs matplotlib."""
from __future__ import annotations

import io
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from .alignment import RowAlignment
from .report import RectificationReport

_MOST_POINTS = 4000
"""Dots of a plot."""
_COLOURS = 'coolwarm'
_IMAGE, _TITLE = 4.4, 0.6
"""Inches: width of an image, height of what stands around one."""


def plot_reports(reports: Mapping[str, RectificationReport]) -> bytes:
    """A PNG with a row a report: left the points, right the field, both over the image, in px."""
    heights = [_IMAGE * report.shape[0] / report.shape[1] + _TITLE for report in reports.values()]
    figure = Figure(figsize=(11, sum(heights) + _TITLE), layout='constrained')
    rows = figure.subplots(len(reports), 2, squeeze=False, height_ratios=heights)
    figure.supxlabel('offset: row in the right image minus row in the left')
    for (name, report), (points, field) in zip(reports.items(), rows, strict=True):
        height, width = report.shape
        alignment = report.alignment or RowAlignment.identity(width, height)
        x, y = np.meshgrid(np.linspace(0, width - 1, 80), np.linspace(0, height - 1, 60))
        dy = alignment.offsets(x, y)
        end = max(0.2, float(np.abs(dy).max()), 1.5 * report.residuals[0])
        step = -(-report.points.size // _MOST_POINTS) or 1
        x_right, row, offset = (values[::step] for values in report.points)
        dots = points.scatter(x_right, row, c=offset, s=6, cmap=_COLOURS, vmin=-end, vmax=end)
        pairs = 'a pair' if report.pairs == 1 else f'{report.pairs} pairs'
        points.set_title(f'{name}: {report.points.size} points of {pairs}')
        field.pcolormesh(x, y, dy, cmap=_COLOURS, vmin=-end, vmax=end, shading='gouraud')
        if np.ptp(dy) > 0:
            field.clabel(field.contour(x, y, dy, 8, colors='black', linewidths=0.7), fontsize=8)
        field.set_title(f'field: {report.verdict.value}' if report.alignment else f'no field: {report.verdict.value}')
        for ax in (points, field):
            ax.set(xlim=(0, width - 1), ylim=(height - 1, 0), aspect='equal')
        figure.colorbar(dots, ax=[points, field], label='offset (px)')
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', dpi=100)
    return buffer.getvalue()
