"""The stereo matcher: the paper's four stages in order."""
from __future__ import annotations

import dataclasses
import threading
from typing import Any

import numpy as np

from .disparity_refinement.refinement import Refinement
from .exact_route import ExactRoute
from .kernels.arrays import Bool, Float32, Image
from .kernels.stripes import block_count
from .matching_cost.intensity_range import IntensityRange
from .matching_cost.preparation import PairImages, fill_levels, images_of
from .disparity_optimization.winners import Winners
from .parameters import MatcherParameters
from .phases import Crew, Phase, StageClock
from .stripe_route import StripeRoute

# numba's portable threading layer aborts the process when two threads run parallel kernels at once.
_KERNELS = threading.Lock()

# Settings that between them run every kernel, whatever the others are; median windows in vectors of each width.
_ALL_STAGES: tuple[dict[str, Any], ...] = tuple(
    {'aggregation': aggregation, 'p2': p2, 'paths': paths, 'median_scope': scope, 'median_guide': 'image', **window}
    for aggregation, p2, paths, scope, window in (
        ('tree', 0.0, 4, 'all', {}), ('tree', 1.0, 4, 'filled', {}), ('box', 1.0, 3, 'filled', {'w_p': 11}),
        ('box', 1.0, 4, 'filled', {'w_p': 41}), ('box', 1.0, 3, 'filled', {'w_p': 21})))


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
    """Dense disparity of a rectified pair, the left image as reference: d = x_left - x_right.

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
        self._crew = Crew()
        self._images: PairImages | None = None
        self._kept: dict[type, tuple[tuple[object, ...], Any]] = {}

    def compute(self, left: Image, right: Image) -> DisparityResult:
        """Match a pair: uint8 or uint16, both (H, W) grey or both (H, W, 3) BGR, any strides.

        Raises ValueError naming what is wrong with which image.
        """
        left, right = _checked(left, right)
        with _KERNELS:
            return self._compute(left, right, self.parameters)

    def warm_up(self) -> None:
        """Compile all kernels, or load them from numba's cache, by matching small images. Seconds to a minute."""
        for stages in _ALL_STAGES:
            matcher = StereoMatcher(self.parameters.replace(**stages), self.threads)
            for shape in ((4, 6), (4, 6, 3)):
                for depth in (np.uint8, np.uint16):
                    matcher.compute(np.zeros(shape, depth), np.zeros(shape, depth))

    def _compute(self, left: Image, right: Image, parameters: MatcherParameters) -> DisparityResult:
        clock = StageClock()
        images = self._prepare(left, right, clock)
        winners = self._match(images, parameters, clock)
        refinement = self._keep(Refinement, Refinement.layout(left.shape, parameters), left.shape, parameters)
        disparity, valid = refinement.run(winners, images, parameters, self._crew, clock)
        return DisparityResult(disparity, valid, clock.milliseconds())

    def _prepare(self, left: Image, right: Image, clock: StageClock) -> PairImages:
        """Grey levels of 8 bits, which do not depend on the depth of the images."""
        self._crew.gather(self.threads)
        with clock.stage('matching_cost'):
            own = self.parameters.intensity_range == 'pair'
            found = IntensityRange.of(left, right) if own else IntensityRange.full(left.dtype)
            self._images = images = images_of(left, right, found, self._images)
        clock.work(self._crew, [Phase('matching_cost', 2 * block_count(left.shape[0]), fill_levels, (images,))])
        return images

    def _match(self, images: PairImages, parameters: MatcherParameters, clock: StageClock) -> Winners:
        """Stages 1 to 3: with the exact tree where the paper's equations are asked for, else by stripes."""
        shape = images.left.shape
        if parameters.aggregation == 'tree' and parameters.p2 == 0:
            layout = ExactRoute.layout(shape, parameters, self._crew.threads)
            exact = self._keep(ExactRoute, layout, shape, parameters, self._crew.threads)
            return exact.run(images, parameters, self._crew, clock)
        route = self._keep(StripeRoute, StripeRoute.layout(shape, parameters), shape, parameters)
        clock.work(self._crew, route.phases(images, parameters))
        return route.result()

    def _keep(self, kind: type, layout: tuple[object, ...], *arguments: Any) -> Any:
        """The last frame's buffers where they fit, else new ones."""
        kept, value = self._kept.get(kind, (None, None))
        if kept != layout:
            self._kept.pop(kind, None)  # free the old ones before the new ones are made
            value = None
            value = kind(*arguments)
            self._kept[kind] = layout, value
        return value


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
