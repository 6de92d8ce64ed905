"""By what the rows of a pair are aligned on the page, as `align_rows` says."""
from __future__ import annotations

import time

from svdm_core import RowAlignment, RowTracker, estimate_row_alignment

from ..frames.frame_preparation import PreparedFrame
from ..frames.row_offsets import row_offsets, row_points

_PERIOD = 1.0
"""s between two looks."""


class StillRows:
    """Of one pair, which is all there is: by what it shows itself."""

    def __init__(self) -> None:
        self._setting: object = None
        self._rows: RowAlignment | None = None
        self._told: dict[str, str] = {}

    def __call__(self, frame: PreparedFrame) -> RowAlignment | None:
        """None where there is nothing to correct, or it is not to be."""
        setting = frame.row_setting, frame.parameters.align_rows
        if setting != self._setting:
            pair = frame.pair.left, frame.pair.right
            is_off = frame.parameters.align_rows == 'off'
            self._rows = None if is_off else estimate_row_alignment(pair, *frame.search)
            self._told = _offset(frame, self._rows)
            self._setting = setting
        return self._rows

    def figures(self) -> dict[str, str]:
        """What is left of the vertical offset."""
        return self._told


class SeenRows:
    """Of a stream: by what its pairs have shown so far, as the node has it, but measured in the matcher's thread."""

    def __init__(self) -> None:
        self._setting: object = None
        self._tracker = RowTracker(0, 1)
        self._next = 0.0
        self._told: dict[str, str] = {}

    def __call__(self, frame: PreparedFrame) -> RowAlignment | None:
        """As of StillRows."""
        if frame.row_setting != self._setting:
            self._setting, self._next = frame.row_setting, 0.0
            self._tracker = RowTracker(*frame.search)
        is_off = frame.parameters.align_rows == 'off'
        rows = None if is_off else self._tracker.alignment
        if time.monotonic() >= self._next:
            if not is_off and (rows is None or frame.parameters.align_rows == 'track'):
                self._tracker.look(frame.pair.left, frame.pair.right)
                rows = self._tracker.alignment
            self._told = _offset(frame, rows)
            self._next = time.monotonic() + _PERIOD
        return None if rows is None or rows.is_identity else rows

    def figures(self) -> dict[str, str]:
        """As of StillRows."""
        return self._told


def _offset(frame: PreparedFrame, rows: RowAlignment | None) -> dict[str, str]:
    low, count = frame.search
    points = row_points(frame.pair.left, frame.pair.right, (low, low + count - 1))
    if points is None:
        return {}
    left = row_offsets(points, rows)
    told = f'{left.median:+.2f} px, 90 % below {left.p90:.2f} px'
    return {'vertical offset': told if rows is None else f'{told} (rows aligned)'}
