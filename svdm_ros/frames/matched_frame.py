"""What a pair came to: all that outputs are made from."""
from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from .colours import coloured

if TYPE_CHECKING:
    from ..calibration.geometry import StereoGeometry
    from ..node.parameter_set import NodeParameters

END_MARGIN = 0.5
"""px; by so much the min_disparity and max_disparity of a message lie outside the disparities that occur: some readers
drop values that are equal to them."""


@dataclasses.dataclass(frozen=True)
class MatchedFrame:
    """A pair that has been matched.

    header: of the left image. left: the left image as it was matched, uint8 or uint16, (H, W) or (H, W, 3) BGR.
    disparity: float32 (H, W), px, x_left - x_right in the images as matched. checked: bool (H, W), where the left-right
    check passed. known: bool (H, W), where there is a disparity to be published. step: px, what disparities are
    multiples of, 0 where they can be any float32. geometry: of the images as matched.
    """

    header: Any
    left: NDArray[Any]
    disparity: NDArray[np.float32]
    checked: NDArray[np.bool_]
    known: NDArray[np.bool_]
    step: float
    geometry: StereoGeometry
    parameters: NodeParameters

    @property
    def limits(self) -> tuple[np.float32, np.float32]:
        """The smallest and the largest disparity that can be published, px."""
        offset, matcher = np.float32(self.geometry.principal_offset), self.parameters.matcher
        smallest = np.float32(matcher.min_disparity)
        return smallest - offset, smallest + np.float32(matcher.num_disparities - 1) - offset

    @property
    def checked_share(self) -> float:
        """Share of the pixels that passed the left-right check, 0 .. 1."""
        return int(np.count_nonzero(self.checked)) / self.checked.size

    @functools.cached_property
    def published(self) -> NDArray[np.float32]:
        """float32 (H, W), px: d = x_left - x_right - (cx_left - cx_right); 1 px below the message's min_disparity
        where there is none.

        All in float32, so that no disparity is rounded to below the smallest.
        """
        values = self.disparity - np.float32(self.geometry.principal_offset)
        np.copyto(values, self.limits[0] - np.float32(END_MARGIN + 1), where=~self.known)
        return values

    @functools.cached_property
    def depth(self) -> NDArray[np.float32]:
        """float32 (H, W), m: Z = f T / d; NaN where there is no disparity above 0, or f or T is not known."""
        distance = np.float32(self.geometry.focal_length * self.geometry.baseline)
        if distance <= 0:
            return np.full(self.disparity.shape, np.nan, np.float32)
        with np.errstate(divide='ignore'):
            values = distance / self.published
        np.copyto(values, np.float32(np.nan), where=~(self.known & (self.published > 0)))
        return values

    @functools.cached_property
    def picture(self) -> NDArray[np.uint8]:
        """The disparities in colours, over the search range, uint8 BGR (H, W, 3); black where there is none."""
        return coloured(self.published, *map(float, self.limits))
