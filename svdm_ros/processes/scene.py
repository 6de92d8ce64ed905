"""The stereo pair that is shown: Motorcycle of Middlebury 2014, as scikit-image carries it (a quarter of full size)."""
from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray


@dataclasses.dataclass(frozen=True, slots=True)
class Calibration:
    """Of two rectified cameras: focal_length, cx, cy and principal_offset in px, baseline in m.

    cx is the left camera's; principal_offset is cx_left - cx_right, and a point at x_l and x_r lies at
    Z = focal_length * baseline / (x_l - x_r - principal_offset).
    """

    focal_length: float
    cx: float
    cy: float
    principal_offset: float
    baseline: float

    def projection(self, side: str) -> list[float]:
        """The 3x4 matrix P of the 'left' or the 'right' camera, row by row."""
        is_right = side == 'right'
        cx = self.cx - self.principal_offset * is_right
        tx = -self.focal_length * self.baseline * is_right
        return [self.focal_length, 0.0, cx, tx, 0.0, self.focal_length, self.cy, 0.0, 0.0, 0.0, 1.0, 0.0]


# As the docstring of skimage.data.stereo_motorcycle() has it; its "principal point dx" is cx_right - cx_left.
MOTORCYCLE = Calibration(focal_length=994.978, cx=311.193, cy=254.877, principal_offset=-31.086, baseline=0.193001)
NUM_DISPARITIES = 64  # px; the ground truth ends at 59.9


@dataclasses.dataclass(frozen=True, slots=True)
class Scene:
    """left, right: uint8 (H, W, 3) in the order B, G, R. ground_truth: float32 (H, W), x_l - x_r in px, inf unknown."""

    left: NDArray[np.uint8]
    right: NDArray[np.uint8]
    ground_truth: NDArray[np.float32]


def load_scene() -> Scene:
    """Read the pair from scikit-image's own files; nothing is downloaded."""
    from skimage.data import stereo_motorcycle

    left, right, ground_truth = stereo_motorcycle()
    return Scene(_bgr(left), _bgr(right), np.asarray(ground_truth, np.float32))


def _bgr(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.ascontiguousarray(rgb[:, :, ::-1])
