"""Stage 3, semi-global: what a jump of the disparity costs between two neighbours, less where the image has an edge."""
from __future__ import annotations

import cv2
import numpy as np

from ..kernels.arrays import Image, Uint8, Uint16

FROM_LEFT, FROM_ABOVE = 0, 1


def penalties_shape(height: int, width: int) -> tuple[int, int, int]:
    """Shape of the penalties of two views."""
    return 2, 2, (height + 1) * width


def fill_penalties(left: Uint8, right: Uint8, p1: int, p2: int, p2_edge: float, penalties: Uint16) -> None:
    """P2 of each step from a pixel to the next: p2 / (1 + edge / p2_edge), at least p1 (as Hirschmueller 2008, eq 13).

    The edge is that of the tree (eq 9): the largest channel difference, in grey levels. left, right: uint8 (H, W) or
    (H, W, 3). p1, p2: in the unit of the path costs. p2_edge: grey levels, 0 for p2 everywhere.
    penalties: uint16 of `penalties_shape`, view 0 the left image and view 1 the mirrored right one; FROM_LEFT of pixel
    k = y W + x is that of the step between k - 1 and k, FROM_ABOVE between k - W and k. The rest has no meaning.
    """
    if p2_edge == 0:
        penalties[:] = p2
        return
    table = np.maximum(np.rint(p2 / (1 + np.arange(256) / p2_edge)), p1).astype(np.uint16)
    for view, image in enumerate((left, right[:, ::-1])):
        planes = cv2.split(image)
        height, width = image.shape[:2]
        maps = penalties[view].reshape(2, height + 1, width)
        if width > 1:
            maps[FROM_LEFT, :-1, 1:] = _looked_up([cv2.absdiff(plane[:, 1:], plane[:, :-1]) for plane in planes], table)
        if height > 1:
            maps[FROM_ABOVE, 1:-1] = _looked_up([cv2.absdiff(plane[1:], plane[:-1]) for plane in planes], table)


def _looked_up(differences: list[Image], table: Uint16) -> Image:
    largest = differences[0]
    for difference in differences[1:]:
        largest = cv2.max(largest, difference)
    return cv2.LUT(largest, table)
