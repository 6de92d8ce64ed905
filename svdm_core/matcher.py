"""The stereo matcher: the paper's four stages in order."""
from __future__ import annotations

import contextlib
import dataclasses
import threading
import time
from collections.abc import Iterator
from typing import Any

import cv2
import numba
import numpy as np

from .cost_aggregation.spanning_forest import SpanningTrees
from .cost_aggregation.tree import ForestNodes, aggregate, aggregate_volume
from .disparity_optimization.penalties import fill_penalties, penalties_shape
from .disparity_optimization.semiglobal import cost_factor, padded, scaled_penalties, scratch_size, semiglobal_winners
from .disparity_optimization.winners import Winners
from .disparity_refinement.left_right import left_right_check
from .disparity_refinement.refinement import refine
from .kernels.arrays import Bool, Float32, Image, Int32, Uint8, aligned_zeros
from .kernels.compilation import THREADS
from .matching_cost.planes import BLOCK, MatchingPlanes
from .parameters import MatcherParameters

# numba's portable threading layer aborts the process when two threads run parallel kernels at once.
_KERNELS = threading.Lock()

# Most that the costs in work may take, where one block of either view takes less: memory must not grow with the cores.
_COST_BYTES = 256 * 2**20

# Settings that between them run every kernel.
_ALL_STAGES: tuple[dict[str, Any], ...] = (
    {'aggregation': 'tree', 'p2': 0.0}, {'aggregation': 'tree', 'p2': 1.0}, {'aggregation': 'box', 'p2': 1.0})


@dataclasses.dataclass(frozen=True, slots=True)
class DisparityResult:
    """What `StereoMatcher.compute` gives back; the arrays are the caller's own.

    disparity: float32 (H, W), px, dense, each in min_disparity .. min_disparity + num_disparities - 1.
    valid: bool (H, W), True where the left-right check passed (eq 15).
    timings: stage name -> milliseconds, and their sum 'total'.
    """

    disparity: Float32
    valid: Bool
    timings: dict[str, float]


class StereoMatcher:
    """Dense disparity of a rectified pair, the left image as reference: d = x_left - x_right >= 0.

    `parameters` may be exchanged between frames. `threads` is the number of threads, 0 for all cores;
    the result does not depend on it. Buffers are kept from frame to frame, so use one matcher for one
    stream of images, and from one thread at a time.
    """

    def __init__(self, parameters: MatcherParameters | None = None, threads: int = 0) -> None:
        """Raises ValueError when `threads` is negative."""
        if not isinstance(threads, int) or threads < 0:
            raise ValueError(f'threads = {threads!r} is not allowed: it must be an integer, 0 (all cores) or more')
        self.parameters = parameters or MatcherParameters()
        self.threads = threads
        self._buffers: _Buffers | None = None

    def compute(self, left: Image, right: Image) -> DisparityResult:
        """Match a pair: uint8 or uint16, both (H, W) grey or both (H, W, 3) BGR, any strides.

        Raises ValueError naming what is wrong with which image.
        """
        left, right = _checked(left, right)
        with _KERNELS:
            numba.set_num_threads(min(self.threads or THREADS, THREADS))
            return self._compute(left, right, self.parameters)

    def warm_up(self) -> None:
        """Compile all kernels, or load them from numba's cache, by matching small images. Seconds to a minute."""
        small = [np.zeros(shape, depth) for shape in ((4, 6), (4, 6, 3)) for depth in (np.uint8, np.uint16)]
        for stages in _ALL_STAGES:
            matcher = StereoMatcher(MatcherParameters(num_disparities=2, median_scope='all', **stages), self.threads)
            for image in small:
                matcher.compute(image, image)

    def _compute(
        self, left: Image, right: Image, parameters: MatcherParameters
    ) -> DisparityResult:
        clock = _StageClock()
        buffers = self._buffers_for(left, parameters)
        if parameters.aggregation == 'tree':
            winner, vertex = self._along_trees(left, right, parameters, buffers, clock)
        else:
            winner, vertex = self._in_boxes(left, right, parameters, buffers, clock)
        with clock.stage('disparity_refinement'):
            valid = left_right_check(winner[0], winner[1], parameters.min_disparity, parameters.tau_lr)
            disparity = refine(winner[0], vertex if parameters.subpixel else None, valid, left, parameters)
        return DisparityResult(disparity, valid, clock.milliseconds())

    def _along_trees(
        self, left: Image, right: Image, parameters: MatcherParameters, buffers: _Buffers, clock: _StageClock
    ) -> tuple[Int32, Float32]:
        """Stages 1 to 3 with the paper's aggregation: winners of both views, sub-pixel offsets of the left."""
        shape = left.shape[:2]
        trees, nodes, planes = buffers.trees, buffers.nodes, buffers.planes
        with clock.stage('spanning_forest'):
            # The costs are not needed yet; what is left there, small integers, are finite floats.
            scratch = buffers.scratch[:, 0].view(np.int32)
            trees.build(_tree_guide(left, parameters), _tree_guide(right, parameters)[:, ::-1], scratch)
        with clock.stage('matching_cost'):
            planes.fill(left, right, parameters.gradient)
            nodes.gather(trees, planes, shape[1], parameters)
        if parameters.p2 == 0:
            with clock.stage('cost_aggregation'):
                aggregate(trees, nodes, planes, parameters, buffers.scratch, buffers.winners)
            with clock.stage('disparity_optimization'):
                return buffers.winners.images(trees.pixel, shape, parameters.num_disparities, buffers.layout.per_slot)
        with clock.stage('cost_aggregation'):
            aggregate_volume(trees, nodes, planes, parameters, buffers.scratch, cost_factor(parameters),
                             padded(parameters.num_disparities), buffers.volume)
        with clock.stage('disparity_optimization'):
            return _smoothed(left, right, parameters, buffers)

    def _in_boxes(
        self, left: Image, right: Image, parameters: MatcherParameters, buffers: _Buffers, clock: _StageClock
    ) -> tuple[Int32, Float32]:
        """The same with 3x3 boxes, which are summed up while the rows are smoothed."""
        with clock.stage('matching_cost'):
            buffers.planes.fill(left, right, parameters.gradient)
            buffers.nodes.gather_pixels(buffers.planes, left.shape[1])
        with clock.stage('disparity_optimization'):
            return _smoothed(left, right, parameters, buffers)

    def _buffers_for(self, image: Image, parameters: MatcherParameters) -> _Buffers:
        """The last frame's buffers where they fit, else new ones."""
        layout = _Layout.of(image.shape, parameters)
        if self._buffers is None or self._buffers.layout != layout:
            self._buffers = None  # free the old ones before the new ones are made
            self._buffers = _Buffers(layout)
        return self._buffers


def _slots(nodes: int, num_disparities: int) -> int:
    """Ranges of disparities in work side by side: one for each two threads, as long as they fit into _COST_BYTES."""
    blocks = -(-num_disparities // BLOCK)
    fitting = _COST_BYTES // (2 * nodes * BLOCK * 4)
    wanted = max(1, min(numba.get_num_threads() // 2, blocks, fitting))
    return -(-blocks // -(-blocks // wanted))  # none of them empty


@dataclasses.dataclass(frozen=True)
class _Layout:
    """What the sizes of the buffers follow from."""

    shape: tuple[int, ...]
    min_disparity: int
    num_disparities: int
    census: bool
    subpixel: bool
    slots: int
    tree: bool
    volume: bool
    from_below: bool

    @classmethod
    def of(cls, shape: tuple[int, ...], parameters: MatcherParameters) -> _Layout:
        """The layout for images of `shape`."""
        tree, smooth = parameters.aggregation == 'tree', parameters.p2 > 0
        from_below = smooth and parameters.paths == 4
        slots = _slots(shape[0] * shape[1], parameters.num_disparities)
        return cls(shape, parameters.min_disparity, parameters.num_disparities, parameters.census_weight > 0,
                   parameters.subpixel, slots, tree, (tree and smooth) or from_below, from_below)

    @property
    def per_slot(self) -> int:
        """Disparities of one slot, whole blocks."""
        return -(-self.num_disparities // (self.slots * BLOCK)) * BLOCK


class _Buffers:
    """Scratch kept from frame to frame.

    Without semi-global optimisation all disparities never exist at once: with S slots, each view takes
    S * BLOCK / D of a cost volume. Semi-global optimisation after the tree stores the volume in 16 bits, and the path
    from below another.
    """

    def __init__(self, layout: _Layout) -> None:
        nodes = layout.shape[0] * layout.shape[1]
        tree_nodes = nodes if layout.tree else 0
        stride = padded(layout.num_disparities)
        self.layout = layout
        end = layout.min_disparity + max(layout.slots * layout.per_slot, stride)
        self.planes = MatchingPlanes.empty(layout.shape, end, layout.census)
        self.trees = SpanningTrees.empty(layout.shape if layout.tree else (0, 0))
        self.nodes = ForestNodes.empty(self.planes, nodes)
        self.scratch = aligned_zeros((2, layout.slots, tree_nodes * BLOCK), np.float32)
        self.winners = Winners.empty(layout.slots, 0 if layout.volume else tree_nodes, layout.subpixel)
        self.volume = aligned_zeros((2, nodes * stride if layout.volume else 0), np.uint16)
        rows = 0 if layout.tree and not layout.volume else scratch_size(layout.shape[1], layout.num_disparities)
        self.lines = aligned_zeros((2, rows), np.uint16)
        smooth = rows > 0
        self.penalties = np.zeros(penalties_shape(*layout.shape[:2]) if smooth else (2, 2, 0), np.uint16)
        self.below = aligned_zeros((2, nodes * stride if layout.from_below else 0), np.uint16)


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
    left: Image, right: Image
) -> tuple[Image, Image]:
    for name, image in (('left', left), ('right', right)):
        if not isinstance(image, np.ndarray):
            raise ValueError(f'{name} image: {type(image).__name__} is not allowed: it must be a numpy array')
        if image.dtype not in (np.uint8, np.uint16):
            raise ValueError(f'{name} image: dtype {image.dtype} is not allowed: it must be uint8 or uint16')
        if image.ndim not in (2, 3) or (image.ndim == 3 and image.shape[2] != 3) or 0 in image.shape:
            raise ValueError(f'{name} image: shape {image.shape} is not allowed: '
                             'it must be (H, W) or (H, W, 3), not empty')
    if left.shape != right.shape or left.dtype != right.dtype:
        raise ValueError(f'left image {left.shape} {left.dtype} and right image {right.shape} {right.dtype} '
                         'must have the same shape and dtype')
    # numba compiles anew for read-only arrays, which messages give: a copy is cheaper.
    return np.require(left, requirements=('C', 'W')), np.require(right, requirements=('C', 'W'))


def _smoothed(left: Image, right: Image, parameters: MatcherParameters, buffers: _Buffers) -> tuple[Int32, Float32]:
    penalties = buffers.penalties
    fill_penalties(_in_8_bit(left), _in_8_bit(right), *scaled_penalties(parameters), parameters.p2_edge, penalties)
    return semiglobal_winners(buffers.nodes, buffers.planes, parameters, left.shape[:2], buffers.volume, buffers.below,
                              buffers.lines, penalties)


def _in_8_bit(image: Image) -> Uint8:
    return (image >> 8).astype(np.uint8) if image.dtype == np.uint16 else image


def _tree_guide(image: Image, parameters: MatcherParameters) -> Uint8:
    """The image the tree is built on: 8 bit, so that an edge weighs 0..255 grey levels, smoothed if wanted."""
    guide = _in_8_bit(image)
    return guide if parameters.guide_blur == 1 else np.asarray(cv2.medianBlur(guide, parameters.guide_blur), np.uint8)
