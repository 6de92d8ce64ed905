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
from numpy.typing import NDArray

from .parameters import MatcherParameters

# Disparities worked on at a time by one thread. 16 float32 are one cache line a node, and a block of
# all nodes stays in the last-level cache.
BLOCK = 16

# Far outside the intensities 0..1 and gradients -1..1.5, so that any truncation bites.
_NO_PARTNER = np.float32(1e3)

_FULL_SCALE = {np.dtype(np.uint8): 255, np.dtype(np.uint16): 65535}


def view_planes(
    left: NDArray[np.generic], right: NDArray[np.generic], parameters: MatcherParameters
) -> NDArray[np.float32]:
    """What stage 1 compares, for the left view and, mirrored, the right view.

    left, right: uint8 or uint16, (H, W) or (H, W, 3) BGR. Returns float32 (2, C + 1, H, pitch): C
    intensities on 0..1 and the gradient of the grey image; columns from W on hold `_NO_PARTNER`.
    """
    height, width = left.shape[:2]
    channels = 1 if left.ndim == 2 else left.shape[2]
    reach = parameters.min_disparity + -(-parameters.num_disparities // BLOCK) * BLOCK
    planes = np.full((2, channels + 1, height, width + reach), _NO_PARTNER, np.float32)
    for view, image in zip(planes, (left, right), strict=True):
        columns = slice(None) if image is left else slice(None, None, -1)
        view[:channels, :, :width] = intensities(image)[..., columns]
        view[channels, :, :width] = gradient(_grey(image), parameters.gradient)[:, columns]
    return planes


def intensities(image: NDArray[np.generic]) -> NDArray[np.float32]:
    """uint8 or uint16 (H, W) or (H, W, 3) as float32 planes (C, H, W) on 0..1."""
    height, width = image.shape[:2]
    planes = np.moveaxis(image.reshape(height, width, -1), 2, 0)
    return planes.astype(np.float32) / np.float32(_FULL_SCALE[image.dtype])


def gradient(grey: NDArray[np.generic], kind: str) -> NDArray[np.float32]:
    """Gradient of a grey uint8 or uint16 image (H, W) on intensities 0..1, borders replicated; float32 (H, W).

    'horizontal' is the signed x difference of eq 3, halved; 'magnitude' is eq 5, differences not halved.
    """
    image = np.pad(grey.astype(np.float32) / np.float32(_FULL_SCALE[grey.dtype]), 1, mode='edge')
    along_x = image[1:-1, 2:] - image[1:-1, :-2]
    if kind == 'horizontal':
        return along_x / 2
    along_y = image[2:, 1:-1] - image[:-2, 1:-1]
    return np.sqrt(along_x**2 + along_y**2)


def _grey(image: NDArray[np.generic]) -> NDArray[np.generic]:
    return image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)


@numba.njit(cache=True)
def _cost_block(partner, values, planes, first, tau_ad, tau_gm, alpha, cost):
    """cost[k, j] (N, BLOCK): matching cost of node k at disparity first + j (eq 8).

    partner: int32 (N,), flat index of the node's partner at disparity 0 in the other view's `planes`
    (C + 1, H * pitch); values: (N, C + 1).
    """
    one, gradients = planes[0], planes[planes.shape[0] - 1]
    if planes.shape[0] == 2:
        for k in range(partner.size):
            start = partner[k] + first
            row, a, g = cost[k], one[start:start + BLOCK], gradients[start:start + BLOCK]
            v0, vg = values[k, 0], values[k, 1]
            for j in range(BLOCK):
                row[j] = min(abs(v0 - a[j]), tau_ad) + alpha * min(abs(vg - g[j]), tau_gm)
        return
    two, three = planes[1], planes[2]
    for k in range(partner.size):
        start = partner[k] + first
        row, a, b = cost[k], one[start:start + BLOCK], two[start:start + BLOCK]
        c, g = three[start:start + BLOCK], gradients[start:start + BLOCK]
        v0, v1, v2, vg = values[k, 0], values[k, 1], values[k, 2], values[k, 3]
        for j in range(BLOCK):
            difference = (abs(v0 - a[j]) + abs(v1 - b[j]) + abs(v2 - c[j])) * np.float32(1 / 3)
            row[j] = min(difference, tau_ad) + alpha * min(abs(vg - g[j]), tau_gm)


@numba.njit(cache=True, parallel=True)
def matching_cost_blocks(partner, values, planes, first, tau_ad, tau_gm, alpha, cost):
    """Fill cost (2, blocks, N, BLOCK) for both views; block b starts at disparity first + b * BLOCK."""
    views, blocks = cost.shape[:2]
    for task in numba.prange(views * blocks):
        view, block = task // blocks, task % blocks
        _cost_block(partner[view], values[view], planes[1 - view], first + block * BLOCK,
                    tau_ad, tau_gm, alpha, cost[view, block])
