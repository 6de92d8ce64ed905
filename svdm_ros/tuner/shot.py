"""What the page shows of one pair: arrays, and figures beside them."""
from __future__ import annotations

import dataclasses

import numpy as np
from numpy.typing import NDArray

from svdm_core.kernels.arrays import Bool, Float32, Image

from ..frames.matched_frame import MatchedFrame


@dataclasses.dataclass(frozen=True)
class Shot:
    """A matched pair.

    number: grows with each. left: uint8 or uint16, (H, W) or (H, W, 3). disparity: float32 (H, W), px. known: bool (H,
    W), what has a disparity; trusted: what has a depth. confidence: float32 (H, W); None where it is not there. limits:
    smallest and largest disparity, px. truth: float32 (H, W), px, not finite where unknown; None where there is none.
    is_moving: whether it is of another pair than the one before. is_matched: whether the left image is that of the
    disparity.
    """

    number: int
    left: Image
    disparity: Float32
    known: Bool
    trusted: Bool
    confidence: Float32 | None
    limits: tuple[float, float]
    truth: Float32 | None = None
    is_moving: bool = True
    is_matched: bool = True

    @classmethod
    def of(cls, frame: MatchedFrame, number: int, truth: Float32 | None, *, is_moving: bool = True) -> Shot:
        """What came of a pair; a truth of another size, as with `roi` and `downscale`, is left out."""
        if truth is not None and truth.shape != frame.disparity.shape:
            truth = None
        low, high = map(float, frame.limits)
        return cls(number, frame.left, frame.shifted, frame.known, frame.trusted, frame.confidence, (low, high), truth,
                   is_moving)

    @property
    def error(self) -> Float32 | None:
        """float32 (H, W), px: disparity less truth; NaN where either is unknown. None without truth."""
        if self.truth is None:
            return None
        known = self.known & np.isfinite(self.truth)
        return np.where(known, self.disparity - self.truth, np.float32(np.nan))


def grey_bytes(image: Image) -> NDArray[np.uint8]:
    """An image as uint8, (H, W) or (H, W, 3); 16 bits are stretched from the darkest to the brightest."""
    if image.dtype == np.uint8:
        return image
    low, high = np.percentile(image, (0.5, 99.5))
    return np.asarray(np.clip((image - low) * (255 / max(high - low, 1.0)), 0, 255), np.uint8)
