"""What happens to a pair of images, and to its geometry and search range, before it is matched."""
from __future__ import annotations

import functools
import math
from typing import TYPE_CHECKING, Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from .exposure import exposure_of, matched

if TYPE_CHECKING:
    from ..calibration.geometry import StereoGeometry
    from ..node.parameter_set import NodeParameters

_MOST_DISPARITIES = 1024
_BEYOND = 1e6  # px, as good as infinite


class PreparedPair(NamedTuple):
    """left, right: the images to be matched, uint8 or uint16, (H, W) or (H, W, 3). geometry: of these images. note:
    what should be known of them."""

    left: NDArray[Any]
    right: NDArray[Any]
    geometry: StereoGeometry
    note: str = ''


def prepare(
    left: NDArray[Any], right: NDArray[Any], geometry: StereoGeometry, parameters: NodeParameters
) -> PreparedPair:
    """Cut out `roi`, shrink by `downscale`, which changes no depth, and even out the exposure by `exposure_match`.

    Raises ValueError where the images have no such part.
    """
    region = parameters.region
    if region is not None:
        height, width = left.shape[:2]
        if region.x + region.width > width or region.y + region.height > height:
            raise ValueError(f'roi = {parameters.roi!r} is not within the image of {width}x{height} px')
        rows, columns = slice(region.y, region.y + region.height), slice(region.x, region.x + region.width)
        left, right, geometry = left[rows, columns], right[rows, columns], geometry.cropped(region.x, region.y)
    factor = parameters.downscale
    if factor > 1:
        if min(left.shape[:2]) < factor:
            raise ValueError(f'downscale = {factor} leaves nothing of {left.shape[1]}x{left.shape[0]} px')
        left, right, geometry = _shrunk(left, factor), _shrunk(right, factor), geometry.shrunk(factor)
    note = ''
    if parameters.exposure_match == 'gain':
        exposure = exposure_of(left, right)
        right = matched(right, exposure)
        if exposure.differs_much(np.iinfo(left.dtype).max):
            note = ('the exposures of the two images differ much, which exposure_match evens out: synchronize them')
    return PreparedPair(left, right, geometry, note)


def _shrunk(image: NDArray[Any], factor: int) -> NDArray[Any]:
    """Means of factor x factor px; what is left over at the right and below is cut off."""
    height, width = image.shape[0] // factor, image.shape[1] // factor
    whole = np.ascontiguousarray(image[:height * factor, :width * factor])
    return np.asarray(cv2.resize(whole, (width, height), interpolation=cv2.INTER_AREA))


@functools.lru_cache(maxsize=8)
def with_search_range(parameters: NodeParameters, geometry: StereoGeometry) -> tuple[NodeParameters, str]:
    """The parameters with num_disparities for `min_depth` where that is set, and what is wrong with the range.

    Both are checked and made once for a stream of pairs, not for each.
    """
    if parameters.min_depth == 0:
        return parameters, ''
    distance = geometry.focal_length * geometry.baseline
    if distance == 0:
        return parameters, 'min_depth is not used, as the focal length or the baseline is not known'
    start = parameters.matcher.min_disparity
    largest = min(distance / parameters.min_depth + geometry.principal_offset, _BEYOND)
    wanted = math.ceil(largest) - start + 1
    count = min(max(wanted, 1), _MOST_DISPARITIES)
    problem = '' if wanted == count else (
        f'min_depth = {parameters.min_depth:g} m takes disparities {start} to {start + wanted - 1} px, and {count} of '
        f'them, from {start} on, are searched: set downscale, min_disparity or another min_depth')
    return parameters.replace({'num_disparities': count}), problem


def beyond_reach(geometry: StereoGeometry, start: int) -> str:
    """What is not searched where the principal points differ and the search begins nearer than infinity, or empty.

    start: min_disparity, px. It is no fault: nothing may be that far.
    """
    infinity = geometry.principal_offset
    if abs(infinity) < 1 or start <= infinity:
        return ''
    distance = geometry.focal_length * geometry.baseline
    farthest = f'beyond {distance / (start - infinity):.3g} m' if distance > 0 else 'far away'
    return (f'nothing {farthest} is found, as the search begins at {start} px and infinity lies at {infinity:g} px, by '
            f'which the principal points differ: set min_disparity to {math.floor(infinity)} if anything is there')
