"""What a pair came to: all that outputs are made from."""
from __future__ import annotations

import dataclasses
import functools
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from .colours import coloured
from .filtering import filled_or_valid, within_depths, without_speckles

if TYPE_CHECKING:
    from ..calibration.geometry import StereoGeometry
    from ..node.parameter_set import NodeParameters

END_MARGIN = 0.5
"""px; by so much the min_disparity and max_disparity of a message lie outside the disparities that occur: some readers
drop values that are equal to them."""


@dataclasses.dataclass(frozen=True)
class MatchedFrame:
    """A pair that has been matched. What is made of it is made when it is asked for, and once.

    header: of the left image. left: the left image as it was matched, uint8 or uint16, (H, W) or (H, W, 3) BGR.
    disparity: float32 (H, W), px, x_left - x_right in the images as matched. valid: bool (H, W), where it was measured
    and not filled in. confidence: float32 (H, W), 0 .. 1. step: px, what disparities are multiples of, 0 where they can
    be any float32. geometry: of the images as matched.

    Two masks, bool (H, W), say what is known: `trusted` that which has a depth, `known` that which has a disparity in
    the message. All that is trusted is known.
    """

    header: Any
    left: NDArray[Any]
    disparity: NDArray[np.float32]
    valid: NDArray[np.bool_]
    confidence: NDArray[np.float32]
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
    def valid_share(self) -> float:
        """Share of the pixels that are valid, 0 .. 1."""
        return int(np.count_nonzero(self.valid)) / self.valid.size

    @property
    def confident_share(self) -> float:
        """Share of the pixels whose confidence reaches `confidence_threshold`, 0 .. 1."""
        return int(np.count_nonzero(self.confident)) / self.confident.size

    @functools.cached_property
    def confident(self) -> NDArray[np.bool_]:
        """bool (H, W): whose confidence reaches `confidence_threshold`; with 0 all."""
        return self.confidence >= np.float32(self.parameters.confidence_threshold)

    @functools.cached_property
    def candidates(self) -> NDArray[np.bool_]:
        """bool (H, W): what `publish_filled` and the depths leave."""
        candidates = filled_or_valid(self.valid, self.parameters)
        within = within_depths(self.disparity, self.geometry, self.parameters)
        return candidates if within is None else candidates & within

    @functools.cached_property
    def trusted(self) -> NDArray[np.bool_]:
        """bool (H, W): what has a depth, in all outputs but the disparity: confident, and no speckle among these."""
        return without_speckles(self.disparity, self.candidates & self.confident, self.parameters)

    @functools.cached_property
    def known(self) -> NDArray[np.bool_]:
        """bool (H, W): what has a disparity in the message: with `publish_filled` whatever its confidence."""
        if not self.parameters.publish_filled or self.parameters.confidence_threshold == 0:
            return self.trusted
        return without_speckles(self.disparity, self.candidates, self.parameters)

    @functools.cached_property
    def shifted(self) -> NDArray[np.float32]:
        """float32 (H, W), px: d = x_left - x_right - (cx_left - cx_right) of every pixel.

        All in float32, so that no disparity is rounded to below the smallest.
        """
        return self.disparity - np.float32(self.geometry.principal_offset)

    @functools.cached_property
    def published(self) -> NDArray[np.float32]:
        """float32 (H, W), px: `shifted`; 1 px below the message's min_disparity where there is none."""
        values = self.shifted.copy()
        np.copyto(values, self.limits[0] - np.float32(END_MARGIN + 1), where=~self.known)
        return values

    @functools.cached_property
    def depth(self) -> NDArray[np.float32]:
        """float32 (H, W), m: Z = f T / d of what is trusted; NaN where there is no disparity above 0, or f or T is not
        known."""
        distance = np.float32(self.geometry.focal_length * self.geometry.baseline)
        if distance <= 0:
            return np.full(self.disparity.shape, np.nan, np.float32)
        with np.errstate(divide='ignore'):
            values = distance / self.shifted
        np.copyto(values, np.float32(np.nan), where=~(self.trusted & (self.shifted > 0)))
        return values

    @functools.cached_property
    def picture(self) -> NDArray[np.uint8]:
        """The disparities in colours, over the search range, uint8 BGR (H, W, 3); black where none is trusted."""
        picture = coloured(self.shifted, *map(float, self.limits))
        return np.asarray(cv2.bitwise_and(picture, picture, mask=self.trusted.view(np.uint8)), np.uint8)
