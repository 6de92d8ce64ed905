"""Whether pairs are rectified: what is measured, what it means and what to do."""
from __future__ import annotations

import dataclasses
import enum
from collections.abc import Iterable

import numpy as np

from ..kernels.arrays import Image
from .alignment import RowAlignment, RowPoints
from .estimation import estimate_grey, grey_pairs
from .fitting import FEWEST_POINTS, pooled
from .measurement import FURTHEST_SEEN, measured

_GOOD = 0.1
"""px, rms of the field over the image: below, an alignment changes next to nothing."""
_CALIBRATE = 1.0
"""px, rms of the field over the image: from here on the calibration is what is wrong."""
_FAR = 0.5
"""px, median of the offsets that no field explains, of pairs that are not rectified."""


class Verdict(enum.Enum):
    """What a pair's offsets mean; the value is a word for a table."""

    ALIGNED = 'aligned'
    SLIGHTLY_OFF = 'slightly off'
    OFF = 'off'
    NOT_RECTIFIED = 'not rectified'
    UNKNOWN = 'unknown'


_ADVICE = {
    Verdict.ALIGNED: 'nothing to do',
    Verdict.SLIGHTLY_OFF: 'align the rows: --align-rows of svdm match and process_bag, align_rows of the node',
    Verdict.OFF: 'align the rows (--align-rows, or align_rows of the node) until the cameras are calibrated anew',
    Verdict.NOT_RECTIFIED: 'rectify the images, or calibrate the cameras anew; check that '
                           'both are of the same moment',
    Verdict.UNKNOWN: 'too few points were found again: take pairs with more texture, or a larger --num-disparities; '
                     'check that left and right are not exchanged',
}


@dataclasses.dataclass(frozen=True, slots=True)
class RectificationReport:
    """shape: (H, W) of the images. pairs: how many were measured. points: the offsets as they were found, in a search
    of up to 7 rows. alignment: None where there is nothing to correct, or nothing to be told."""

    shape: tuple[int, int]
    pairs: int
    points: RowPoints
    alignment: RowAlignment | None
    verdict: Verdict

    @property
    def advice(self) -> str:
        """What to do, one line."""
        return _ADVICE[self.verdict]

    @property
    def residuals(self) -> tuple[float, float]:
        """Medians of the absolute offsets, px, without and with the alignment; 0 where no point was found."""
        dy = self.points.dy
        if not dy.size:
            return 0.0, 0.0
        left = dy if self.alignment is None else dy - self.alignment.offsets(self.points.x_right, self.points.y)
        return float(np.median(np.abs(dy))), float(np.median(np.abs(left)))

    def places(self) -> dict[str, float]:
        """The offset at the centre and in the four corners of the image, px; 0 without an alignment."""
        height, width = self.shape
        return (self.alignment or RowAlignment.identity(width, height)).places()


def check_rectification(
    pairs: Iterable[tuple[Image, Image]] | tuple[Image, Image], min_disparity: int, num_disparities: int,
) -> RectificationReport:
    """How far the rows of one pair, or of several pairs of the same cameras, are apart.

    Arguments as of `estimate_row_alignment`. Raises ValueError where there is no pair, or where sizes differ.
    """
    grey = grey_pairs(pairs)
    if not grey:
        raise ValueError('there is no pair to be checked')
    search = (min_disparity, min_disparity + num_disparities - 1)
    rows = estimate_grey(grey, search)
    seen = pooled([measured(*pair, search, furthest=FURTHEST_SEEN) for pair in grey])
    height, width = grey[0].left.shape
    return RectificationReport((height, width), len(grey), seen, rows, _verdict(rows, seen))


def _verdict(rows: RowAlignment | None, seen: RowPoints) -> Verdict:
    if seen.size < FEWEST_POINTS:
        return Verdict.UNKNOWN
    if rows is None:
        return Verdict.NOT_RECTIFIED if np.median(np.abs(seen.dy)) > _FAR else Verdict.ALIGNED
    size = field_rms(rows)
    if size < _GOOD:
        return Verdict.ALIGNED
    return Verdict.OFF if size >= _CALIBRATE else Verdict.SLIGHTLY_OFF


def field_rms(rows: RowAlignment) -> float:
    """Root mean square of the field over the image, px."""
    x, y = np.meshgrid(np.linspace(0, rows.width - 1, 33), np.linspace(0, rows.height - 1, 33))
    return float(np.sqrt(np.mean(rows.offsets(x, y)**2)))
