"""Stage 1, matching cost: truncated absolute and gradient differences (eqs 1-8) and, if wanted, a census distance.

What is compared lies in planes of whole 64ths of an 8-bit grey level: exact but for gradient magnitudes and
16-bit images. The right view is matched on the mirrored pair, so both views have the same form: reference
pixel x at disparity d meets column W - 1 - x + d of the other view's mirrored image, a forward step in memory
for each step in d. What lies behind the last column costs the most there is, which is what x - d < 0 costs.
"""
from __future__ import annotations

import dataclasses

import cv2
import numba
import numpy as np

from ..kernels.arrays import Float32, Image, Int16, Int32, Uint8, UInt64
from ..kernels.compilation import kernel
from ..kernels.vectors import absolute, count_ones, load, minimum, splat, to_float, where_equal
from ..parameters import MatcherParameters

# Disparities worked on at a time by one thread: one vector, and one cache line a node.
BLOCK = 16

# Intensity 1 in the planes, and in the costs.
INTENSITY = 64 * 255

# Stands in every plane where there is no pixel; no intensity or gradient is so low.
_NOTHING = np.int16(-(2**15))

# Neighbours compared by the census: a window whose bits fit into one integer, px.
_CENSUS_ROWS, _CENSUS_COLUMNS = 7, 9
CENSUS_BITS = _CENSUS_ROWS * _CENSUS_COLUMNS - 1

# Nodes gathered by one task.
_CHUNK = 4096

# What the kernels know of the parameters: tau_ad, tau_gm, alpha, weight of one census bit, the largest cost.
CostScale = tuple[np.float32, np.float32, np.float32, np.float32, np.float32]


@dataclasses.dataclass(frozen=True, slots=True)
class MatchingPlanes:
    """What stage 1 compares, view 0 the left image and view 1 the mirrored right one.

    values: int16 (2, C + 1, H, pitch), C intensities and the gradient of the grey image, unit 1 / INTENSITY;
    census: uint64 (2, H, pitch), one bit for each neighbour darker than the pixel, or (2, 0, 0) without census.
    Columns 0 .. W - 1 are the image, the rest holds no pixel.
    """

    values: Int16
    census: UInt64

    @classmethod
    def empty(cls, shape: tuple[int, ...], end: int, census: bool) -> MatchingPlanes:
        """Room for images of `shape` (H, W) or (H, W, 3), matched at disparities below `end`."""
        height, width = shape[:2]
        values = np.full((2, 2 if len(shape) == 2 else shape[2] + 1, height, width + end), _NOTHING, np.int16)
        return cls(values, np.zeros((2, height, width + end) if census else (2, 0, 0), np.uint64))

    def fill(self, left: Image, right: Image, kind: str) -> None:
        """Take over a pair, uint8 or uint16, (H, W) or (H, W, 3) BGR; kind: of `gradient`."""
        for view, image in enumerate((left, right)):
            grey = _grey(image)
            values, mirrored = self.values[view], view == 1
            unit = np.float32(INTENSITY) * _unit(image)
            _fill_colours(image.reshape(*image.shape[:2], -1), unit, mirrored, values)
            _fill_gradient(grey, unit, kind == 'magnitude', mirrored, values[-1])
            if self.census.size:
                _fill_census(grey, mirrored, self.census[view])


def intensities(image: Image) -> Float32:
    """uint8 or uint16 (H, W) or (H, W, 3) as float32 planes (C, H, W) on 0..1."""
    planes = np.moveaxis(image.reshape(*image.shape[:2], -1), 2, 0)
    return planes.astype(np.float32, order='C') * _unit(image)


def cost_scale(parameters: MatcherParameters) -> CostScale:
    """The parameters of stage 1 in units of the planes."""
    tau_ad, tau_gm = parameters.tau_ad * INTENSITY, parameters.tau_gm * INTENSITY
    census = parameters.census_weight * INTENSITY
    largest = tau_ad + parameters.alpha * tau_gm + census
    return (np.float32(tau_ad), np.float32(tau_gm), np.float32(parameters.alpha), np.float32(census / CENSUS_BITS),
            np.float32(largest))


def cost_terms(parameters: MatcherParameters) -> tuple[bool, bool]:
    """Whether the differences of eqs 1-7 have any weight, and whether the census has."""
    return parameters.tau_ad > 0 or parameters.alpha * parameters.tau_gm > 0, parameters.census_weight > 0


def _unit(image: Image) -> np.float32:
    """Intensity on 0..1 of one grey level of the image."""
    return np.float32(1 / 255 if image.dtype == np.uint8 else 1 / 65535)


def _grey(image: Image) -> Image:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))


@kernel(parallel=True)
def _fill_colours(image: Image, unit: np.float32, mirrored: bool, planes: Int16) -> None:
    height, width, channels = image.shape
    for y in numba.prange(height):
        for c in range(channels):
            to = planes[c, y]
            for x in range(width):
                column = width - 1 - x if mirrored else x
                to[x] = np.int16(np.rint(np.float32(image[y, column, c]) * unit))


@kernel(parallel=True)
def _fill_gradient(grey: Image, unit: np.float32, magnitude: bool, mirrored: bool, plane: Int16) -> None:
    """Signed x difference, halved (eq 3), or magnitude, differences not halved (eq 5); borders replicated."""
    height, width = grey.shape
    for y in numba.prange(height):
        row = np.empty(width + 2, np.float32)
        row[0], row[1:-1], row[width + 1] = grey[y, 0], grey[y], grey[y, width - 1]
        slope = np.float32(0.5) * (row[2:] - row[:-2])
        if magnitude:
            above, below = grey[max(y - 1, 0)], grey[min(y + 1, height - 1)]
            for x in range(width):
                along_y = np.float32(below[x]) - np.float32(above[x])
                slope[x] = np.sqrt(np.float32(4) * slope[x] * slope[x] + along_y * along_y)
        to = plane[y, :width][::-1] if mirrored else plane[y, :width][::1]
        for x in range(width):
            to[x] = np.int16(np.rint(slope[x] * unit))


@kernel(parallel=True)
def _fill_census(grey: Image, mirrored: bool, plane: UInt64) -> None:
    """One bit for each neighbour that is darker than the pixel, in reading order; borders replicated."""
    height, width = grey.shape
    across, along = _CENSUS_COLUMNS // 2, _CENSUS_ROWS // 2
    for y in numba.prange(height):
        row = grey[y]
        near = np.empty((_CENSUS_ROWS, width + 2 * across), grey.dtype)
        for i in range(_CENSUS_ROWS):
            other = grey[min(max(y + i - along, 0), height - 1)]
            near[i, :across] = other[0]
            near[i, across:across + width] = other
            near[i, across + width:] = other[width - 1]
        bits = np.zeros((8, width), np.uint8)  # a byte at a time: more pixels in each vector
        bit = 64 - CENSUS_BITS
        for i in range(_CENSUS_ROWS):
            for j in range(_CENSUS_COLUMNS):
                if i != along or j != across:
                    _append_bit(near[i, j:j + width], row, bits[bit // 8])
                    bit += 1
        to = plane[y, :width][::-1] if mirrored else plane[y, :width][::1]
        _join_bytes(bits, to)


@kernel
def _append_bit(neighbour: Image, pixel: Image, byte: Uint8) -> None:
    for x in range(pixel.size):
        byte[x] = np.uint8(byte[x] << np.uint8(1)) | np.uint8(neighbour[x] < pixel[x])


@kernel
def _join_bytes(bits: Uint8, words: UInt64) -> None:
    for x in range(words.size):
        word = np.uint64(0)
        for k in range(8):
            word = (word << np.uint64(8)) | np.uint64(bits[k, x])
        words[x] = word


@kernel(parallel=True)
def gather_pixels(values: Int16, census: UInt64, width: int, partner: Int32, own: Float32, own_census: UInt64) -> None:
    """What `gather_nodes` does where the nodes are the pixels in their order."""
    views, count, height, pitch = values.shape
    for y in numba.prange(height):
        for view in range(views):
            first = y * width
            for x in range(width):
                partner[view, first + x] = y * pitch + width - 1 - x
            for c in range(count):
                for x in range(width):
                    own[view, (first + x) * count + c] = np.float32(values[view, c, y, x])
            if own_census.size:
                own_census[view, first:first + width] = census[view, y, :width]


@kernel(parallel=True)
def gather_nodes(
    values: Int16, census: UInt64, pixel: Int32, width: int, partner: Int32, own: Float32, own_census: UInt64
) -> None:
    """What stage 1 needs of each view's nodes: values, census of `MatchingPlanes`; pixel int32 (2, N).

    Writes partner, int32 (2, N): flat index of the node's partner at disparity 0 in the other view's planes;
    own, float32 (2, N * (C + 1)): the nodes' values; and own_census, uint64 (2, N), empty without census.
    """
    views, nodes = pixel.shape
    count, _, pitch = values.shape[1:]
    for chunk in numba.prange(-(-nodes // _CHUNK)):
        for view in range(views):
            for k in range(chunk * _CHUNK, min(nodes, (chunk + 1) * _CHUNK)):
                y, x = pixel[view, k] // width, pixel[view, k] % width
                partner[view, k] = y * pitch + width - 1 - x
                for c in range(count):
                    own[view, k * count + c] = np.float32(values[view, c, y, x])
                if own_census.size:
                    own_census[view, k] = census[view, y, x]


@kernel
def cost_vector(own, own_census, k, values, census, terms, planes, size, start, scale):  # type: ignore[no-untyped-def]
    """Costs of node k, a vector over BLOCK disparities (eq 8), unit 1 / INTENSITY.

    own (N * (C + 1)), own_census (N): of `gather_nodes` or `gather_pixels`, one view, flat. values, census: the other
    view's planes, flat, `size` the length of each; start: where in a plane the first partner lies. scale: a
    `CostScale`; terms: of `cost_terms`.
    """
    tau_ad, tau_gm, alpha, bit, largest = scale
    has_differences, has_census = terms
    first = k * planes
    slope = load(values, (planes - 1) * size + start)
    cost = splat(np.float32(0))
    if has_differences:
        difference = absolute(splat(own[first]) - to_float(load(values, start)))
        if planes == 4:
            second = absolute(splat(own[first + 1]) - to_float(load(values, size + start)))
            third = absolute(splat(own[first + 2]) - to_float(load(values, 2 * size + start)))
            difference = (difference + second + third) * splat(np.float32(1 / 3))
        slope_difference = absolute(splat(own[first + planes - 1]) - to_float(slope))
        cost = minimum(difference, splat(tau_ad)) + splat(alpha) * minimum(slope_difference, splat(tau_gm))
    if has_census:
        distance = count_ones(splat(own_census[k]) ^ load(census, start))
        cost = cost + splat(bit) * to_float(distance)
    return where_equal(slope, splat(_NOTHING), splat(largest), cost)
