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

from .arrays import Bool, Float32, Image, Uint8
from .cost_aggregation import ForestNodes, aggregate
from .disparity_optimization import Winners
from .disparity_refinement import left_right_check, refine
from .matching_cost import BLOCK, MatchingPlanes
from .parameters import MatcherParameters
from .spanning_forest import SpanningTrees

# numba's portable threading layer aborts the process when two threads run parallel kernels at once.
_KERNELS = threading.Lock()

# The threads numba started with: its cores, or what NUMBA_NUM_THREADS says.
_CORES = numba.get_num_threads()

# Most that the costs in work may take, where one block of either view takes less: memory must not grow with the cores.
_COST_BYTES = 256 * 2**20


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
            numba.set_num_threads(min(self.threads or _CORES, _CORES))
            return self._compute(left, right, self.parameters)

    def warm_up(self) -> None:
        """Compile all kernels, or load them from numba's cache, by matching small images. Seconds to a minute."""
        matcher = StereoMatcher(self.parameters.replace(num_disparities=2, median_scope='all'), self.threads)
        for depth in (np.uint8, np.uint16):
            small = np.zeros((4, 6), depth)
            matcher.compute(small, small)

    def _compute(
        self, left: Image, right: Image, parameters: MatcherParameters
    ) -> DisparityResult:
        height, width = left.shape[:2]
        clock = _StageClock()
        buffers = self._buffers_for(left, parameters)
        with clock.stage('spanning_forest'):
            buffers.trees.build(_tree_guide(left, parameters), _tree_guide(right, parameters)[:, ::-1])
        with clock.stage('matching_cost'):
            buffers.planes.fill(left, right, parameters.gradient)
            buffers.nodes.gather(buffers.trees, buffers.planes, width, parameters)
        with clock.stage('cost_aggregation'):
            aggregate(buffers.trees, buffers.nodes, buffers.planes, parameters,
                      buffers.scratch, buffers.winners)
        with clock.stage('disparity_optimization'):
            winner, vertex = buffers.winners.images(buffers.trees.pixel, (height, width), parameters.num_disparities,
                                                    buffers.layout.per_slot)
        with clock.stage('disparity_refinement'):
            valid = left_right_check(winner[0], winner[1], parameters.min_disparity, parameters.tau_lr)
            disparity = refine(winner[0], vertex if parameters.subpixel else None, valid, left, parameters)
        return DisparityResult(disparity, valid, clock.milliseconds())

    def _buffers_for(self, image: Image, parameters: MatcherParameters) -> _Buffers:
        """The last frame's buffers where they fit, else new ones."""
        layout = _Layout(
            shape=image.shape,
            min_disparity=parameters.min_disparity,
            num_disparities=parameters.num_disparities,
            census=parameters.census_weight > 0,
            slots=_slots(image.shape[0] * image.shape[1], parameters.num_disparities),
        )
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
    slots: int

    @property
    def per_slot(self) -> int:
        """Disparities of one slot, whole blocks."""
        return -(-self.num_disparities // (self.slots * BLOCK)) * BLOCK


class _Buffers:
    """Scratch kept from frame to frame: the planes compared, a block of costs for each slot, the winners so far.

    All disparities never exist at once: with S slots, memory is S * BLOCK / D of a cost volume for each view.
    """

    def __init__(self, layout: _Layout) -> None:
        nodes = layout.shape[0] * layout.shape[1]
        self.layout = layout
        end = layout.min_disparity + layout.slots * layout.per_slot
        self.planes = MatchingPlanes.empty(layout.shape, end, layout.census)
        self.trees = SpanningTrees.empty(layout.shape)
        self.nodes = ForestNodes.empty(self.planes, nodes)
        self.scratch = np.zeros((2, layout.slots, nodes * BLOCK), np.float32)
        self.winners = Winners.empty(layout.slots, nodes)


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


def _tree_guide(image: Image, parameters: MatcherParameters) -> Uint8:
    """The image the tree is built on: 8 bit, so that an edge weighs 0..255 grey levels, smoothed if wanted."""
    guide: Uint8 = (image >> 8).astype(np.uint8) if image.dtype == np.uint16 else image
    return guide if parameters.guide_blur == 1 else np.asarray(cv2.medianBlur(guide, parameters.guide_blur), np.uint8)
