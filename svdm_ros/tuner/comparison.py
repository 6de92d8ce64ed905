"""Two sets of parameters on one and the same pair."""
from __future__ import annotations

import threading
from typing import NamedTuple

from svdm_core import NotEnoughMemoryError
from svdm_core.shown import line

from ..frames.frame_processing import FrameProcessor
from ..frames.views import FrameError, StereoFrame
from ..node.parameter_set import NodeParameters
from .live_figures import LiveFigures
from .pictures import different_share
from .row_sources import StillRows
from .shot import Shot


class Compared(NamedTuple):
    """A: what was held. B: what is there now. different: share of the pixels that differ by more than 1 px, %; None
    where the maps have different sizes."""

    first: Shot
    second: Shot
    first_figures: dict[str, str]
    second_figures: dict[str, str]
    different: float | None


class Comparison:
    """A pair that is held, and the set that it was held with; matched in this process, beside whatever else runs."""

    def __init__(self, frame: StereoFrame, held: NodeParameters) -> None:
        self.held = held
        self._frame = frame
        self._rows = StillRows()
        self._processor = FrameProcessor(rows=self._rows)
        self._lock = threading.Lock()
        self._first: tuple[Shot, dict[str, str]] | None = None
        self._number = 0

    def against(self, now: NodeParameters) -> Compared:
        """A is matched once, B each time. ValueError where one of them cannot be, in one line. May take a second."""
        with self._lock:
            if self._first is None:
                self._first = self._matched(self.held)
            second, figures = self._matched(now)
            first, first_figures = self._first
            return Compared(first, second, first_figures, figures, different_share(first, second))

    def _matched(self, parameters: NodeParameters) -> tuple[Shot, dict[str, str]]:
        try:
            done = self._processor.process(self._frame, parameters)
        except (FrameError, NotEnoughMemoryError) as error:
            raise ValueError(line(error)) from None
        self._number += 1
        shot = Shot.of(done.frame, self._number, None)
        return shot, {'time of a frame': f'{done.timings["total"]:.1f} ms',
                      'valid pixels': f'{100 * done.frame.valid_share:.1f} %', **LiveFigures().of(shot, parameters)}
