"""OpenCV's matchers as yardsticks, with the settings of OpenCV's own documentation."""
from __future__ import annotations

import cv2
import numpy as np

from ..disparity_refinement.checking import fill_along_scanlines
from ..kernels.arrays import Bool, Float32, Image

OPENCV_METHODS = ('bm', 'sgbm-3way', 'sgbm-hh4', 'sgbm-hh')

_BM_BLOCK = 15
_SGBM_BLOCK = 3
_SGBM_MODES = {
    'sgbm-3way': cv2.STEREO_SGBM_MODE_SGBM_3WAY,
    'sgbm-hh4': cv2.STEREO_SGBM_MODE_HH4,
    'sgbm-hh': cv2.STEREO_SGBM_MODE_HH,
}
_FRACTION = 16  # OpenCV's fixed point: sixteenths of a pixel


class OpenCVMatcher:
    """One of OPENCV_METHODS for 8-bit images; BM takes grey images only and converts colour.

    SGBM: block 3, P1 = 8 C b^2, P2 = 32 C b^2, uniqueness 10 %, speckles below 100 px with range 2. BM: block 15.
    num_disparities is rounded up to a multiple of 16, as OpenCV needs it.
    """

    def __init__(self, method: str, num_disparities: int, channels: int) -> None:
        if method not in OPENCV_METHODS:
            raise ValueError(f'method = {method!r} is not allowed: it must be {" | ".join(OPENCV_METHODS)}')
        self.num_disparities = -(-num_disparities // 16) * 16
        self._grey_only = method == 'bm'
        if self._grey_only:
            self._matcher: cv2.StereoMatcher = cv2.StereoBM.create(self.num_disparities, _BM_BLOCK)
            return
        area = channels * _SGBM_BLOCK**2
        self._matcher = cv2.StereoSGBM.create(
            minDisparity=0, numDisparities=self.num_disparities, blockSize=_SGBM_BLOCK, P1=8 * area, P2=32 * area,
            disp12MaxDiff=1, uniquenessRatio=10, speckleWindowSize=100, speckleRange=2, mode=_SGBM_MODES[method])

    def compute(self, left: Image, right: Image) -> Float32:
        """Disparity as OpenCV gives it: float32 (H, W), px, below 0 where it has no answer."""
        if self._grey_only and left.ndim == 3:
            left, right = (cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in (left, right))
        return np.asarray(self._matcher.compute(left, right), np.float32) / np.float32(_FRACTION)

    def compute_dense(self, left: Image, right: Image) -> Float32:
        """The same without holes, to be compared with dense maps: float32 (H, W), px.

        Padded on the left, so that no column is lost, and filled along the scanlines.
        """
        return self.compute_filled(left, right)[0]

    def compute_filled(self, left: Image, right: Image) -> tuple[Float32, Bool]:
        """The map of `compute_dense`, and bool (H, W): where OpenCV had an answer of its own."""
        margin = self.num_disparities
        padded = (cv2.copyMakeBorder(image, 0, 0, margin, 0, cv2.BORDER_REPLICATE) for image in (left, right))
        disparity = self.compute(*padded)[:, margin:]
        steps = np.rint(disparity * _FRACTION).astype(np.int16)
        answered = disparity >= 0
        dense = np.maximum(fill_along_scanlines(steps, answered), 0).astype(np.float32) / np.float32(_FRACTION)
        return dense, answered


def settings_of(method: str) -> str:
    """The settings of one of OPENCV_METHODS in words."""
    if method == 'bm':
        return f'StereoBM, block {_BM_BLOCK}'
    return (f'StereoSGBM, block {_SGBM_BLOCK}, P1 = 8 C b^2, P2 = 32 C b^2 (C channels, b block), uniqueness 10 %, '
            'speckles below 100 px with range 2')
