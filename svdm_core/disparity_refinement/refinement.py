"""Stage 4, disparity refinement: what is valid, how far it can be trusted, filling, medians, planes.

Left-right check (eq 15) and uniqueness, filling (eq 16, or from afar), confidence, bilateral weighted median (eqs
17-19), plain median, plane fit.
"""
from __future__ import annotations

from typing import NamedTuple

import cv2
import numpy as np

from ..disparity_optimization.winners import Winners
from ..kernels.arrays import Bool, Float32, Int16, Uint8, Uint16
from ..kernels.stripes import block_count
from ..matching_cost.planes import intensities
from ..matching_cost.preparation import PairImages
from ..parameters import MatcherParameters
from ..phases import Crew, Phase, StageClock
from . import byte_median, confidence, far_filling, final_median, plane_fit
from .checking import Checked, check_and_fill
from .weighted_median import weighted_median, weighted_median_of_disparity

_STAGE = 'disparity_refinement'


class RefinedMap(NamedTuple):
    """What stage 4 gives, (H, W): disparity float32, px, dense; valid bool; confidence float32, 0 .. 1."""

    disparity: Float32
    valid: Bool
    confidence: Float32


class Refinement:
    """Stage 4 for images of one shape; owns its buffers."""

    def __init__(self, shape: tuple[int, ...], parameters: MatcherParameters) -> None:
        self._shape = shape[:2]
        self._filled = np.zeros(self._shape, np.int16)
        self._labels, self._guide, self._fixed = _byte_maps(shape, parameters.w_p if in_bytes(parameters) else 0)
        afar = parameters.filling == 'far'
        self._runs = np.zeros((shape[0], shape[1] + 2) if afar else (1, 0), np.int32)
        self._far = far_filling.empty_far_maps(shape, parameters.num_disparities) if afar else None
        self._support = np.zeros(self._shape if parameters.plane_fit else (0, 0), np.uint8)
        self._smoothed = np.zeros(self._shape if parameters.plane_fit else (0, 0), np.uint16)

    @staticmethod
    def layout(shape: tuple[int, ...], parameters: MatcherParameters) -> tuple[object, ...]:
        """What the buffers follow from."""
        columns = parameters.num_disparities if parameters.filling == 'far' else 0
        return Refinement, shape, parameters.w_p if in_bytes(parameters) else 0, columns, parameters.plane_fit

    def run(
        self, winners: Winners, images: PairImages, parameters: MatcherParameters, crew: Crew, clock: StageClock
    ) -> RefinedMap:
        """A valid pixel keeps its sub-pixel disparity where its median is its own winner, up to the final median."""
        valid, trust = np.empty(self._shape, np.bool_), np.empty(self._shape, np.float32)
        disparity = np.empty(self._shape, np.float32)
        clock.work(crew, self._checks(winners, valid, images, parameters, trust))
        maps = _Maps(winners, images, valid, self._filled)
        if in_bytes(parameters):
            clock.work(crew, self._medians(maps, parameters, disparity))
        else:
            with clock.stage(_STAGE):
                self._literal(maps, parameters, disparity)
        if parameters.plane_fit:
            clock.work(crew, [self._planes(images, parameters, disparity)])
        return RefinedMap(disparity, valid, trust)

    def _checks(
        self, winners: Winners, valid: Bool, images: PairImages, parameters: MatcherParameters, trust: Float32
    ) -> list[Phase]:
        """What is valid, what the rest is filled with, and how far all can be trusted."""
        (height, width), blocks = self._shape, block_count(self._shape[0])
        least = np.uint8(np.ceil(255 * parameters.uniqueness))
        checked = Checked(winners.left, winners.right, winners.every, parameters.min_disparity,
                          np.float32(parameters.tau_lr), winners.margin, least, valid, self._filled, self._runs)
        evidence = confidence.Evidence(valid, winners.margin, images.left_grey,
                                       confidence.least_texture(float(images.level_gain)))
        phases = [Phase(_STAGE, blocks, check_and_fill, (checked,)),
                  Phase(_STAGE, blocks, confidence.fill_confidence,
                        (evidence, confidence.Trust(trust, self._support)), confidence.scratch_size(width))]
        if self._far is not None:
            window = far_filling.far_window(parameters.num_disparities, float(images.level_unit))
            gaps = far_filling.Gaps(valid, self._filled, self._runs, images.levels)
            arguments, rows = (self._far, window, gaps), far_filling.sampled_rows(self._far)
            phases += [Phase(_STAGE, rows, far_filling.fill_far_maps, arguments),
                       Phase(_STAGE, -(-height // far_filling.ROWS), far_filling.fill_from_afar, arguments,
                             far_filling.scratch_size(width))]
        return phases

    def _medians(self, maps: _Maps, parameters: MatcherParameters, disparity: Float32) -> list[Phase]:
        """In bytes."""
        (height, width), images = self._shape, maps.images
        wanted = byte_median.MedianMaps(self._labels, self._guide, maps.valid, maps.filled, maps.winners.vertex,
                                        self._fixed)
        window = byte_median.median_window(width, parameters.w_p, parameters.sigma_s,
                                           parameters.sigma_c / float(images.level_unit), parameters.num_disparities)
        tasks, lanes = -(-height // byte_median.ROWS), byte_median.window_lanes(parameters.w_p)
        last = disparity[:0, :0] if parameters.plane_fit else disparity
        return [Phase(_STAGE, tasks, byte_median.fill_margins, (wanted, parameters.w_p, images.levels)),
                Phase(_STAGE, tasks, byte_median.take_medians, (wanted, window, lanes),
                      byte_median.scratch_size(parameters.w_p)),
                Phase(_STAGE, block_count(height), final_median.smooth_map,
                      (self._fixed, parameters.final_median, parameters.min_disparity,
                       final_median.SmoothedMap(self._smoothed, last)),
                      final_median.scratch_size(width))]

    def _literal(self, maps: _Maps, parameters: MatcherParameters, disparity: Float32) -> None:
        """With the paper's exact median, of all pixels if wanted."""
        labels, images, vertex = maps.filled.astype(np.int32), maps.images, maps.winners.vertex
        wanted = ~maps.valid if parameters.median_scope == 'filled' else None
        window, sigma_s, sigma_c = parameters.w_p, parameters.sigma_s, parameters.sigma_c
        if parameters.median_guide == 'image':
            guide = intensities(images.left, (images.offset, images.gain))
            median = weighted_median(labels, guide, wanted, window, sigma_s, sigma_c)
        else:
            median = weighted_median_of_disparity(labels, wanted, window, sigma_s, sigma_c, parameters.num_disparities)
        fine = median.astype(np.float32)
        if vertex.size:
            fine += np.where(maps.valid & (median == maps.winners.left), vertex, np.float32(0))
        if parameters.final_median > 1:
            fine = np.asarray(cv2.medianBlur(fine, parameters.final_median), np.float32)
        if parameters.plane_fit:
            self._smoothed[:] = np.rint(byte_median.STEPS * fine)
        else:
            np.add(fine, np.float32(parameters.min_disparity), out=disparity)

    def _planes(self, images: PairImages, parameters: MatcherParameters, disparity: Float32) -> Phase:
        maps = plane_fit.PlaneMaps(self._smoothed, self._support, images.levels)
        search = parameters.min_disparity, parameters.num_disparities
        return Phase(_STAGE, block_count(self._shape[0]), plane_fit.fit_planes,
                     (maps, plane_fit.plane_weights(float(images.level_unit)), search, disparity),
                     plane_fit.scratch_size(self._shape[1], images.levels.shape[0]))


class _Maps(NamedTuple):
    """What the medians take."""

    winners: Winners
    images: PairImages
    valid: Bool
    filled: Int16


def in_bytes(parameters: MatcherParameters) -> bool:
    """Whether the median is that of `byte_median`, else it is the literal one of `weighted_median`."""
    return (parameters.median_scope == 'filled' and parameters.median_guide == 'image'
            and parameters.num_disparities <= byte_median.MOST_DISPARITIES)


def kernels_of(parameters: MatcherParameters) -> tuple[object, ...]:
    """What the types of the kernels' arguments follow from, and which of them are called."""
    more = parameters.filling, parameters.plane_fit
    if in_bytes(parameters):
        return ('bytes', byte_median.window_lanes(parameters.w_p), *more)
    return parameters.median_scope, parameters.median_guide, *more


def disparity_step(parameters: MatcherParameters) -> float:
    """px, what the disparities that come out are multiples of; 0 where they can be any float32."""
    if parameters.plane_fit:
        return 1 / byte_median.STEPS
    if not parameters.subpixel or parameters.num_disparities == 1:
        return 1.0
    return 1 / byte_median.STEPS if in_bytes(parameters) else 0.0


def _byte_maps(shape: tuple[int, ...], w_p: int) -> tuple[Uint8, Uint8, Uint16]:
    if w_p == 0:
        return np.zeros((0, 0), np.uint8), np.zeros((0, 0, 0), np.uint8), np.zeros((0, 0), np.uint16)
    return *byte_median.empty_maps(shape, w_p), np.zeros(shape[:2], np.uint16)
