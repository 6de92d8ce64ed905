"""The stereo matcher: the paper's four stages in order."""
from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
from collections.abc import Iterator

import cv2
import numba
import numpy as np
from numpy.typing import NDArray

from .cost_aggregation import aggregate_blocks, edge_similarity
from .disparity_optimization import Winners
from .disparity_refinement import left_right_check, refine
from .matching_cost import BLOCK, matching_cost_blocks, view_planes
from .parameters import MatcherParameters
from .spanning_forest import minimum_spanning_trees

# numba's portable threading layer aborts the process when two threads run parallel kernels at once.
_KERNELS = threading.Lock()


@dataclasses.dataclass(frozen=True, slots=True)
class DisparityResult:
    """What `StereoMatcher.compute` gives back; the arrays are the caller's own.

    disparity: float32 (H, W), px, dense, each in min_disparity .. min_disparity + num_disparities - 1.
    valid: bool (H, W), True where the left-right check passed (eq 15).
    timings: stage name -> milliseconds, and their sum 'total'.
    """

    disparity: NDArray[np.float32]
    valid: NDArray[np.bool_]
    timings: dict[str, float]


class StereoMatcher:
    """Dense disparity of a rectified pair, the left image as reference: d = x_left - x_right >= 0.

    `parameters` may be exchanged between frames. `threads` is the number of threads, 0 for all cores;
    the result does not depend on it. Buffers are kept from frame to frame, so use one matcher for one
    stream of images, and from one thread at a time.
    """

    def __init__(self, parameters: MatcherParameters | None = None, threads: int = 0) -> None:
        """Raises ValueError when `threads` is negative."""
        if threads < 0:
            raise ValueError(f'threads = {threads} is not allowed: it must be 0 (all cores) or more')
        self.parameters = parameters or MatcherParameters()
        self.threads = threads
        self._winners = Winners.empty(0)
        self._cost = np.empty((2, 0, 0, BLOCK), np.float32)

    def compute(self, left: NDArray[np.generic], right: NDArray[np.generic]) -> DisparityResult:
        """Match a pair: uint8 or uint16, both (H, W) grey or both (H, W, 3) BGR, any strides.

        Raises ValueError naming what is wrong with which image.
        """
        left, right = _checked(left, right)
        with _KERNELS:
            numba.set_num_threads(min(self.threads or numba.config.NUMBA_NUM_THREADS, numba.config.NUMBA_NUM_THREADS))
            return self._compute(left, right, self.parameters)

    def warm_up(self) -> None:
        """Compile all kernels, or load them from numba's cache, by matching small images. Seconds to a minute."""
        small = np.zeros((4, 6), np.uint8)
        matcher = StereoMatcher(self.parameters.replace(num_disparities=2, median_scope='all'), self.threads)
        matcher.compute(small, small)

    def _compute(
        self, left: NDArray[np.generic], right: NDArray[np.generic], parameters: MatcherParameters
    ) -> DisparityResult:
        shape = left.shape[:2]
        clock = _StageClock()
        with clock.stage('spanning_forest'):
            pixel, parent, weight = minimum_spanning_trees(_tree_guide(left, parameters),
                                                           _tree_guide(right, parameters)[:, ::-1])
            similarity = edge_similarity(weight, parameters.sigma_tree, parameters.d_y)
        with clock.stage('matching_cost'):
            planes = view_planes(left, right, parameters)
            partner, values = _node_order(planes, pixel, shape[1])
        self._match_views(planes, partner, values, parent, similarity, parameters, clock)
        with clock.stage('disparity_optimization'):
            winner = _pixel_order(self._winners.index, pixel).reshape(2, *shape)
            vertex = None
            if parameters.subpixel:
                vertex = _pixel_order(self._winners.parabola(parameters.num_disparities)[None], pixel[:1]).reshape(shape)
        with clock.stage('disparity_refinement'):
            valid = left_right_check(winner[0], winner[1, :, ::-1], parameters.min_disparity, parameters.tau_lr)
            disparity = refine(winner[0], vertex, valid, left, parameters)
        return DisparityResult(disparity, valid, clock.milliseconds())

    def _match_views(self, planes, partner, values, parent, similarity, parameters, clock) -> None:
        """Stages 1 to 3 over a few blocks of disparities at a time: the whole cost volume never exists."""
        nodes = parent.shape[1]
        blocks = max(1, numba.get_num_threads() // 2)
        if self._cost.shape != (2, blocks, nodes, BLOCK):
            self._cost = np.empty((2, blocks, nodes, BLOCK), np.float32)
            self._winners = Winners.empty(nodes)
        self._winners.reset()
        flat = planes.reshape(*planes.shape[:2], -1)
        taus = np.float32(parameters.tau_ad), np.float32(parameters.tau_gm), np.float32(parameters.alpha)
        for first in range(0, parameters.num_disparities, blocks * BLOCK):
            count = min(blocks * BLOCK, parameters.num_disparities - first)
            with clock.stage('matching_cost'):
                matching_cost_blocks(partner, values, flat, parameters.min_disparity + first, *taus, self._cost)
            with clock.stage('cost_aggregation'):
                aggregate_blocks(self._cost, parent, similarity)
            with clock.stage('disparity_optimization'):
                self._winners.update(self._cost, first, count)


class _StageClock:
    """Adds up the time spent in each stage."""

    def __init__(self) -> None:
        self._seconds: dict[str, float] = {}

    @contextlib.contextmanager
    def stage(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self._seconds[name] = self._seconds.get(name, 0.0) + time.perf_counter() - start

    def milliseconds(self) -> dict[str, float]:
        stages = {name: 1e3 * seconds for name, seconds in self._seconds.items()}
        return {**stages, 'total': sum(stages.values())}


def _checked(
    left: NDArray[np.generic], right: NDArray[np.generic]
) -> tuple[NDArray[np.generic], NDArray[np.generic]]:
    for name, image in (('left', left), ('right', right)):
        if not isinstance(image, np.ndarray):
            raise ValueError(f'{name} image: {type(image).__name__} is not allowed: it must be a numpy array')
        if image.dtype not in (np.uint8, np.uint16):
            raise ValueError(f'{name} image: dtype {image.dtype} is not allowed: it must be uint8 or uint16')
        if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3) or 0 in image.shape:
            raise ValueError(f'{name} image: shape {image.shape} is not allowed: it must be (H, W) or (H, W, 3), not empty')
    if left.shape != right.shape or left.dtype != right.dtype:
        raise ValueError(f'left image {left.shape} {left.dtype} and right image {right.shape} {right.dtype} '
                         'must have the same shape and dtype')
    return np.ascontiguousarray(left), np.ascontiguousarray(right)


def _tree_guide(image: NDArray[np.generic], parameters: MatcherParameters) -> NDArray[np.uint8]:
    """The image the tree is built on: 8 bit, so that an edge weighs 0..255 grey levels, smoothed if wanted."""
    guide = (image >> 8).astype(np.uint8) if image.dtype == np.uint16 else image
    return guide if parameters.guide_blur == 1 else cv2.medianBlur(guide, parameters.guide_blur)


def _node_order(
    planes: NDArray[np.float32], pixel: NDArray[np.int32], width: int
) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    """For each view's nodes the place of their partners at disparity 0 and their own values, see `_cost_block`."""
    y, x = np.divmod(pixel, np.int32(width))
    partner = y * np.int32(planes.shape[3]) + np.int32(width - 1) - x
    values = np.stack([view[:, row, column].T for view, row, column in zip(planes, y, x, strict=True)])
    return partner, np.ascontiguousarray(values)


def _pixel_order(nodes: NDArray[np.generic], pixel: NDArray[np.int32]) -> NDArray[np.generic]:
    """Values of the nodes (V, N) at their pixels (V, N)."""
    image = np.empty_like(nodes)
    np.put_along_axis(image, pixel, nodes, axis=1)
    return image
