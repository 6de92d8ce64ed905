"""Stage 1, matching cost: truncated absolute difference + alpha x truncated gradient difference (eqs 1-8).

The right view is matched on the mirrored pair, so both views have the same form: reference pixel x at
disparity d meets column W - 1 - x + d of the other view's mirrored image, a forward step in memory for
each step in d. Behind the last column stands a value no image has; its difference truncates to the
largest cost, which is what x - d < 0 costs.
"""
from __future__ import annotations

import cv2
import numba
import numpy as np

from .arrays import Float32, Image, Int32
from .parameters import MatcherParameters

# Disparities worked on at a time by one thread. 16 float32 are one cache line a node, and a block of
# all nodes stays in the last-level cache.
BLOCK = 16

# Far outside the intensities 0..1 and gradients -1..1.5, so that any truncation bites.
_NO_PARTNER = np.float32(1e3)

# Nodes gathered by one task.
_CHUNK = 4096


def empty_planes(height: int, width: int, channels: int, end: int) -> Float32:
    """Room for `fill_planes`, float32 (2, C + 1, H, W + end), with `_NO_PARTNER` in the columns from W on.

    end: the disparity behind the last one of the last block that `matching_cost_blocks` will compute.
    """
    return np.full((2, channels + 1, height, width + end), _NO_PARTNER, np.float32)


def fill_planes(
    left: Image, right: Image, kind: str, planes: Float32
) -> None:
    """Write what stage 1 compares: the left view and, mirrored, the right view.

    left, right: uint8 or uint16, (H, W) or (H, W, 3) BGR. kind: of `gradient`. planes: (2, C + 1, H, pitch),
    receives C intensities on 0..1 and the gradient of the grey image in columns 0 .. W - 1.
    """
    for view, image in enumerate((left, right)):
        colours = image.reshape(*image.shape[:2], -1)
        _fill_planes(colours, gradient(_grey(image), kind), _unit(image), view == 1, planes[view])


def intensities(image: Image) -> Float32:
    """uint8 or uint16 (H, W) or (H, W, 3) as float32 planes (C, H, W) on 0..1."""
    planes = np.moveaxis(image.reshape(*image.shape[:2], -1), 2, 0)
    return planes.astype(np.float32, order='C') * _unit(image)


def gradient(grey: Image, kind: str) -> Float32:
    """Gradient of a grey uint8 or uint16 image (H, W) on intensities 0..1, borders replicated; float32 (H, W).

    'horizontal' is the signed x difference of eq 3, halved; 'magnitude' is eq 5, differences not halved.
    """
    result = np.empty(grey.shape, np.float32)
    _gradient(grey, _unit(grey), kind == 'magnitude', result)
    return result


def _unit(image: Image) -> np.float32:
    """Intensity on 0..1 of one grey level of the image."""
    return np.float32(1 / 255 if image.dtype == np.uint8 else 1 / 65535)


def _grey(image: Image) -> Image:
    return image if image.ndim == 2 else np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY))


def matching_cost_blocks(
    partner: Int32,
    values: Float32,
    planes: Float32,
    first: int,
    parameters: MatcherParameters,
    cost: Float32,
) -> None:
    """Fill cost (2, blocks, N, BLOCK) for both views; block b starts at disparity min_disparity + first + b * BLOCK.

    partner, values: of `node_values`; planes: of `fill_planes`. Disparities behind the search range cost
    something, but nothing sensible.
    """
    taus = np.float32(parameters.tau_ad), np.float32(parameters.tau_gm), np.float32(parameters.alpha)
    flat = planes.reshape(*planes.shape[:2], -1)
    _cost_blocks(partner, values, flat, parameters.min_disparity + first, *taus, cost)


@numba.njit(cache=True, parallel=True)
def _gradient(grey: Image, unit: np.float32, magnitude: bool, result: Float32) -> None:
    height, width = grey.shape
    for y in numba.prange(height):
        above, row, below = grey[max(y - 1, 0)], grey[y], grey[min(y + 1, height - 1)]
        for x in range(width):
            along_x = np.float32(np.int32(row[min(x + 1, width - 1)]) - np.int32(row[max(x - 1, 0)]))
            if magnitude:
                along_y = np.float32(np.int32(below[x]) - np.int32(above[x]))
                result[y, x] = np.sqrt(along_x * along_x + along_y * along_y) * unit
            else:
                result[y, x] = np.float32(0.5) * along_x * unit


@numba.njit(cache=True, parallel=True)
def _fill_planes(image: Image, gradients: Float32, unit: np.float32, mirrored: bool, planes: Float32) -> None:
    height, width, channels = image.shape
    for y in numba.prange(height):
        for c in range(channels + 1):
            to = planes[c, y]
            for x in range(width):
                column = width - 1 - x if mirrored else x
                to[x] = gradients[y, column] if c == channels else np.float32(image[y, column, c]) * unit


@numba.njit(cache=True, parallel=True)
def node_values(planes: Float32, pixel: Int32, width: int) -> tuple[Int32, Float32]:
    """What stage 1 needs of each view's nodes: planes (2, C + 1, H, pitch), pixel int32 (2, N).

    Returns partner, int32 (2, N): flat index of the node's partner at disparity 0 in the other view's
    plane; and values, float32 (2, N, C + 1): the node's own intensities and gradient.
    """
    views, nodes = pixel.shape
    count, pitch = planes.shape[1], planes.shape[3]
    partner = np.empty((views, nodes), np.int32)
    values = np.empty((views, nodes, count), np.float32)
    for chunk in numba.prange(-(-nodes // _CHUNK)):
        for view in range(views):
            for k in range(chunk * _CHUNK, min(nodes, (chunk + 1) * _CHUNK)):
                y, x = pixel[view, k] // width, pixel[view, k] % width
                partner[view, k] = y * pitch + width - 1 - x
                for c in range(count):
                    values[view, k, c] = planes[view, c, y, x]
    return partner, values


@numba.njit(cache=True)
def _cost_block(
    partner: Int32, values: Float32, planes: Float32, first: int, tau_ad: np.float32, tau_gm: np.float32,
    alpha: np.float32, cost: Float32,
) -> None:
    """cost[k, j] (N, BLOCK): matching cost of node k at disparity first + j (eq 8).

    partner: int32 (N,), flat index of the node's partner at disparity 0 in the other view's `planes`
    (C + 1, H * pitch); values: (N, C + 1).
    """
    # Not the constant BLOCK: such a short loop would be unrolled and lose its vector instructions.
    size = cost.shape[1]
    one, gradients = planes[0], planes[planes.shape[0] - 1]
    if planes.shape[0] == 2:
        for k in range(partner.size):
            start = partner[k] + first
            row, a, g = cost[k], one[start:start + size], gradients[start:start + size]
            v0, vg = values[k, 0], values[k, 1]
            for j in range(size):
                row[j] = min(abs(v0 - a[j]), tau_ad) + alpha * min(abs(vg - g[j]), tau_gm)
        return
    two, three = planes[1], planes[2]
    for k in range(partner.size):
        start = partner[k] + first
        row, a, b = cost[k], one[start:start + size], two[start:start + size]
        c, g = three[start:start + size], gradients[start:start + size]
        v0, v1, v2, vg = values[k, 0], values[k, 1], values[k, 2], values[k, 3]
        for j in range(size):
            difference = (abs(v0 - a[j]) + abs(v1 - b[j]) + abs(v2 - c[j])) * np.float32(1 / 3)
            row[j] = min(difference, tau_ad) + alpha * min(abs(vg - g[j]), tau_gm)


@numba.njit(cache=True, parallel=True)
def _cost_blocks(
    partner: Int32, values: Float32, planes: Float32, first: int, tau_ad: np.float32, tau_gm: np.float32,
    alpha: np.float32, cost: Float32,
) -> None:
    views, blocks = cost.shape[:2]
    for task in numba.prange(views * blocks):
        view, block = task // blocks, task % blocks
        _cost_block(partner[view], values[view], planes[1 - view], first + block * BLOCK,
                    tau_ad, tau_gm, alpha, cost[view, block])
