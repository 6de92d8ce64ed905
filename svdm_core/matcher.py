"""The stereo matcher: the paper's four stages in order."""
from __future__ import annotations

import dataclasses
import functools
import threading
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from .disparity_optimization.winners import Winners
from .disparity_refinement.refinement import Refinement, disparity_step, kernels_of
from .exact_route import ExactRoute, is_exact
from .kernels.arrays import Bool, Float32, Image
from .kernels.stripes import block_count
from .kernels.wide import lanes_for, width_of
from .matching_cost.intensity_range import IntensityRange
from .matching_cost.preparation import PairImages, fill_levels, images_of
from .memory import check_memory
from .parameters import STAGES, MatcherParameters, parameter_table
from .phases import Crew, Phase, StageClock
from .row_alignment.alignment import RowAlignment
from .stripe_route import StripeRoute, right_aggregation

# numba's portable threading layer aborts the process when two threads run parallel kernels at once.
_KERNELS = threading.Lock()

# Which kernels this process has run so far, see `_kernels_of`.
_RUN: set[tuple[object, ...]] = set()


@dataclasses.dataclass(frozen=True, slots=True)
class DisparityResult:
    """What `StereoMatcher.compute` gives back; the arrays are the caller's own.

    disparity: float32 (H, W), px, dense, each in min_disparity .. min_disparity + num_disparities - 1.
    valid: bool (H, W), True where the left-right check passed (eq 15) and the winner is unique.
    confidence: float32 (H, W), 0 .. 1: how far the disparity can be trusted, see `svdm_core.chance_wrong`.
    timings: stage name -> milliseconds, and their sum 'total'.
    step: px, what disparities are multiples of; 0 where they can be any float32.
    """

    disparity: Float32
    valid: Bool
    confidence: Float32
    timings: dict[str, float]
    step: float = 0.0


@dataclasses.dataclass(frozen=True, slots=True)
class MatchedPair:
    """What `StereoMatcher.match` gives back and `StereoMatcher.refine` takes: a pair after stages 1 to 3.

    parameters: those it was matched with. images, winners: what stage 4 reads; shape: of the images. seconds: stage
    name -> the time it took.
    """

    parameters: MatcherParameters
    images: PairImages
    winners: Winners
    shape: tuple[int, ...]
    seconds: Mapping[str, float]

    def outdated_by(self, parameters: MatcherParameters) -> list[str]:
        """The parameters of stages 1 to 3 that have other values there: with any, the pair must be matched anew."""
        early = (info.name for info in parameter_table() if info.stage != STAGES[-1])
        return [name for name in early if getattr(self.parameters, name) != getattr(parameters, name)]

    def copy(self) -> MatchedPair:
        """The same with arrays of its own, without what stage 4 does not read."""
        images, winners = self.images, self.winners
        nothing = images.right[:0]
        images = images._replace(left=images.left.copy(), left_grey=images.left_grey.copy(), right=nothing,
                                 levels=images.levels.copy(), right_grey=nothing[..., 0])
        winners = winners._replace(left=winners.left.copy(), right=winners.right.copy(), vertex=winners.vertex.copy(),
                                   margin=winners.margin.copy())
        return dataclasses.replace(self, images=images, winners=winners)


class StereoMatcher:
    """Dense disparity of a rectified pair, the left image as reference: d = x_left - x_right.

    `parameters` may be exchanged between frames. `threads` is the number of threads, 0 for all cores;
    the result does not depend on it. Buffers are kept from frame to frame, so use one matcher for one
    stream of images, and from one thread at a time.
    """

    def __init__(
        self, parameters: MatcherParameters | None = None, threads: int = 0,
        clock: Callable[[], StageClock] = StageClock,
    ) -> None:
        """clock: makes the one of each frame. Raises ValueError when `threads` is negative."""
        if not isinstance(threads, int) or threads < 0:
            raise ValueError(f'threads = {threads!r} is not allowed: it must be an integer, 0 (all cores) or more')
        self.parameters = parameters or MatcherParameters()
        self.threads = threads
        self._new_clock = clock
        self._crew = Crew()
        self._images: PairImages | None = None
        self._kept: dict[Any, tuple[tuple[object, ...], Any]] = {}
        self._afforded: tuple[object, ...] = ()
        self._held = 0  # bytes of what was afforded

    def compute(self, left: Image, right: Image, rows: RowAlignment | None = None) -> DisparityResult:
        """Match a pair: uint8 or uint16, both (H, W) grey or both (H, W, 3) BGR, any strides.

        rows: how far the rows are apart; the right image is aligned by it first, which is 'row_alignment' in the
        timings. Raises ValueError naming what is wrong with which image, and NotEnoughMemoryError (a MemoryError)
        before anything is allocated where the pair needs more memory than is free.
        """
        left, right = _checked(left, right)
        with _KERNELS:
            clock, parameters = self._new_clock(), self.parameters
            self._crew.gather(self.threads)
            return self._refined(self._matched(left, right, rows, parameters, clock), parameters, clock)

    def match(self, left: Image, right: Image, rows: RowAlignment | None = None) -> MatchedPair:
        """Stages 1 to 3 of a pair, as `compute` takes it; the arrays are the caller's own, for as long as wanted."""
        left, right = _checked(left, right)
        with _KERNELS:
            self._crew.gather(self.threads)
            return self._matched(left, right, rows, self.parameters, self._new_clock()).copy()

    def refine(self, matched: MatchedPair) -> DisparityResult:
        """Stage 4, under the parameters that the matcher has now; `compute` is `refine(match(left, right, rows))`.

        Raises ValueError where a parameter of an earlier stage is not what the pair was matched with.
        """
        for name in matched.outdated_by(self.parameters):
            then, now = getattr(matched.parameters, name), getattr(self.parameters, name)
            raise ValueError(f'{name} = {now!r} is not allowed: it must be {then!r}, with which the pair was matched; '
                             'refining it changes parameters of stage 4 only')
        with _KERNELS:
            self._crew.gather(self.threads)
            return self._refined(matched, self.parameters, StageClock(matched.seconds))

    def warm_up(self, depths: Sequence[type[np.unsignedinteger]] = (np.uint8, np.uint16)) -> None:
        """Compile what the present parameters need for grey and colour images of these depths, or load it from numba's
        cache, by matching small images. Seconds to a minute."""
        matcher = StereoMatcher(self.parameters, self.threads)
        for shape in ((4, 6), (4, 6, 3)):
            for depth in depths:
                matcher.compute(np.zeros(shape, depth), np.zeros(shape, depth))

    def not_compiled(self, image: Image) -> str:
        """Where such an image, under the present parameters, is the first of this process that needs certain kernels:
        what they are for, as '16-bit colour images and 65 to 96 disparities'. Its frame compiles them, or loads them
        from the cache. Else empty."""
        if _kernels_of(image.shape, image.dtype, self.parameters) in _RUN:
            return ''
        lanes = lanes_for(self.parameters.num_disparities)
        first = next(count for count in range(1, 1025) if lanes_for(count) == lanes)
        kind = f'{8 * image.dtype.itemsize}-bit {"grey" if image.ndim == 2 else "colour"} images'
        return f'{kind} and {first} to {width_of(lanes)} disparities'

    def _matched(
        self, left: Image, right: Image, rows: RowAlignment | None, parameters: MatcherParameters, clock: StageClock
    ) -> MatchedPair:
        """Its arrays are the matcher's own and the images: valid until the next pair."""
        self._afford(left.shape, parameters, rows is not None)
        if rows is not None:
            with clock.stage('row_alignment'):
                right = rows.apply(right)
        images = self._prepare(left, right, parameters, clock)
        winners = self._winners(images, parameters, clock)
        return MatchedPair(parameters, images, winners, left.shape, clock.seconds)

    def _refined(self, matched: MatchedPair, parameters: MatcherParameters, clock: StageClock) -> DisparityResult:
        refinement = self._keep(Refinement, Refinement.layout(matched.shape, parameters), matched.shape, parameters)
        refined = refinement.run(matched.winners, matched.images, parameters, self._crew, clock)
        _RUN.add(_kernels_of(matched.shape, matched.images.left.dtype, parameters))
        return DisparityResult(*refined, clock.milliseconds(), disparity_step(parameters))

    def _afford(self, shape: tuple[int, ...], parameters: MatcherParameters, is_aligned: bool) -> None:
        """Raises NotEnoughMemoryError where the buffers of such a pair, if they are not there yet, do not fit."""
        wanted = shape, parameters, self._crew.threads, is_aligned
        if wanted != self._afforded:
            self._kept.pop(StripeRoute if is_exact(parameters) else ExactRoute, None)
            self._afforded = ()
            self._held = check_memory(*wanted, self._held)
            self._afforded = wanted

    def _prepare(self, left: Image, right: Image, parameters: MatcherParameters, clock: StageClock) -> PairImages:
        """Grey levels of 8 bits, which do not depend on the depth of the images."""
        with clock.stage('matching_cost'):
            own = parameters.intensity_range == 'pair'
            found = IntensityRange.of(left, right) if own else IntensityRange.full(left.dtype)
            self._images = images = images_of(left, right, found, self._images)
        clock.work(self._crew, [Phase('matching_cost', 2 * block_count(left.shape[0]), fill_levels, (images,))])
        return images

    def _winners(self, images: PairImages, parameters: MatcherParameters, clock: StageClock) -> Winners:
        """Stages 1 to 3: with the exact tree where the paper's equations are asked for, else by stripes."""
        shape = images.left.shape
        if is_exact(parameters):
            layout = ExactRoute.layout(shape, parameters, self._crew.threads)
            exact = self._keep(ExactRoute, layout, shape, parameters, self._crew.threads)
            return exact.run(images, parameters, self._crew, clock)
        route = self._keep(StripeRoute, StripeRoute.layout(shape, parameters), shape, parameters)
        clock.work(self._crew, route.phases(images, parameters))
        return route.result()

    def _keep[Kept](self, kind: Callable[..., Kept], layout: tuple[object, ...], *arguments: Any) -> Kept:
        """The last frame's buffers where they fit, else new ones."""
        if kind not in self._kept or self._kept[kind][0] != layout:
            self._kept.pop(kind, None)  # free the old ones before the new ones are made
            self._kept[kind] = layout, kind(*arguments)
        kept: Kept = self._kept[kind][1]
        return kept


@functools.lru_cache(maxsize=32)
def _kernels_of(shape: tuple[int, ...], dtype: Any, parameters: MatcherParameters) -> tuple[object, ...]:
    """What the types of the kernels' arguments follow from: images with the same take the same kernels."""
    channels = 1 if len(shape) == 2 else shape[2]
    return (str(dtype), channels, is_exact(parameters), lanes_for(parameters.num_disparities), parameters.aggregation,
            right_aggregation(parameters, channels), *kernels_of(parameters))


def _checked(left: Image, right: Image) -> tuple[Image, Image]:
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
