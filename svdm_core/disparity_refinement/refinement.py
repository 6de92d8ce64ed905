"""Stage 4, disparity refinement: left-right check, filling (eqs 15-16), weighted median (eqs 17-19), plain median."""
from __future__ import annotations

import cv2
import numpy as np

from ..disparity_optimization.winners import Winners
from ..kernels.arrays import Bool, Float32, Uint8
from ..kernels.stripes import block_count
from ..matching_cost.planes import intensities
from ..matching_cost.preparation import PairImages
from ..parameters import MatcherParameters
from ..phases import Crew, Phase, StageClock
from . import byte_median, final_median
from .checking import Checked, check_and_fill
from .weighted_median import weighted_median, weighted_median_of_disparity

_STAGE = 'disparity_refinement'


class Refinement:
    """Stage 4 for images of one shape; owns its buffers."""

    def __init__(self, shape: tuple[int, ...], parameters: MatcherParameters) -> None:
        self._shape = shape[:2]
        self._filled = np.zeros(self._shape, np.int16)
        self._labels, self._guide, self._fixed = _byte_maps(shape, parameters.w_p if in_bytes(parameters) else 0)

    @staticmethod
    def layout(shape: tuple[int, ...], parameters: MatcherParameters) -> tuple[object, ...]:
        """What the buffers follow from."""
        return Refinement, shape, parameters.w_p if in_bytes(parameters) else 0

    def run(
        self, winners: Winners, images: PairImages, parameters: MatcherParameters, crew: Crew, clock: StageClock
    ) -> tuple[Float32, Bool]:
        """(disparity, valid): float32 (H, W), px, dense; bool (H, W), where the left-right check passed.

        A valid pixel keeps its sub-pixel disparity where its median is its own winner, up to the final median.
        """
        valid = np.empty(self._shape, np.bool_)
        checked = Checked(winners.left, winners.right, winners.every, parameters.min_disparity,
                          np.float32(parameters.tau_lr), valid, self._filled)
        clock.work(crew, [Phase(_STAGE, block_count(self._shape[0]), check_and_fill, (checked,))])
        if in_bytes(parameters):
            disparity = np.empty(self._shape, np.float32)
            clock.work(crew, self._in_bytes(winners, valid, images, parameters, disparity))
            return disparity, valid
        with clock.stage(_STAGE):
            return self._literal(winners, valid, images, parameters), valid

    def _in_bytes(
        self, winners: Winners, valid: Bool, images: PairImages, parameters: MatcherParameters, disparity: Float32
    ) -> list[Phase]:
        height, width = self._shape
        maps = byte_median.MedianMaps(self._labels, self._guide, valid, self._filled, winners.vertex, self._fixed)
        window = byte_median.median_window(width, parameters.w_p, parameters.sigma_s,
                                           parameters.sigma_c / float(images.level_unit), parameters.num_disparities)
        tasks, lanes = -(-height // byte_median.ROWS), byte_median.window_lanes(parameters.w_p)
        return [Phase(_STAGE, tasks, byte_median.fill_margins, (maps, parameters.w_p, images.levels)),
                Phase(_STAGE, tasks, byte_median.take_medians, (maps, window, lanes),
                      byte_median.scratch_size(parameters.w_p)),
                Phase(_STAGE, block_count(height), final_median.smooth_map,
                      (self._fixed, parameters.final_median, parameters.min_disparity, disparity),
                      final_median.scratch_size(width))]

    def _literal(
        self, winners: Winners, valid: Bool, images: PairImages, parameters: MatcherParameters
    ) -> Float32:
        """With the paper's exact median, of all pixels if wanted."""
        labels = self._filled.astype(np.int32)
        wanted = ~valid if parameters.median_scope == 'filled' else None
        window, sigma_s, sigma_c = parameters.w_p, parameters.sigma_s, parameters.sigma_c
        if parameters.median_guide == 'image':
            guide = intensities(images.left, (images.offset, images.gain))
            median = weighted_median(labels, guide, wanted, window, sigma_s, sigma_c)
        else:
            median = weighted_median_of_disparity(labels, wanted, window, sigma_s, sigma_c, parameters.num_disparities)
        disparity = (median + parameters.min_disparity).astype(np.float32)
        if winners.vertex.size:
            disparity += np.where(valid & (median == winners.left), winners.vertex, np.float32(0))
        if parameters.final_median == 1:
            return disparity
        return np.asarray(cv2.medianBlur(disparity, parameters.final_median))


def in_bytes(parameters: MatcherParameters) -> bool:
    """Whether the median is that of `byte_median`, else it is the literal one of `weighted_median`."""
    return (parameters.median_scope == 'filled' and parameters.median_guide == 'image'
            and parameters.num_disparities <= byte_median.MOST_DISPARITIES)


def kernels_of(parameters: MatcherParameters) -> tuple[object, ...]:
    """What the types of the kernels' arguments follow from."""
    if in_bytes(parameters):
        return ('bytes', byte_median.window_lanes(parameters.w_p))
    return parameters.median_scope, parameters.median_guide


def disparity_step(parameters: MatcherParameters) -> float:
    """px, what the disparities that come out are multiples of; 0 where they can be any float32."""
    if not parameters.subpixel or parameters.num_disparities == 1:
        return 1.0
    return 1 / byte_median.STEPS if in_bytes(parameters) else 0.0


def scratch_size(shape: tuple[int, ...], parameters: MatcherParameters) -> int:
    """Bytes of scratch for each thread."""
    return max(byte_median.scratch_size(parameters.w_p), final_median.scratch_size(shape[1]))


def _byte_maps(shape: tuple[int, ...], w_p: int) -> tuple[Uint8, Uint8, np.ndarray]:
    if w_p == 0:
        return np.zeros((0, 0), np.uint8), np.zeros((0, 0, 0), np.uint8), np.zeros((0, 0), np.uint16)
    return *byte_median.empty_maps(shape, w_p), np.zeros(shape[:2], np.uint16)
