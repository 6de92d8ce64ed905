"""What is tuned on: pairs, with ground truth or without."""
from __future__ import annotations

import hashlib
from typing import NamedTuple

from ..evaluation.datasets import StereoScene
from ..kernels.arrays import Image
from ..parameters import MatcherParameters


class ImagePair(NamedTuple):
    """A pair without ground truth. left, right: uint8 or uint16, (H, W) or (H, W, 3), of one shape. min_disparity,
    num_disparities: what is searched, px."""

    name: str
    left: Image
    right: Image
    min_disparity: int
    num_disparities: int


type AnyPair = StereoScene | ImagePair


def fitted(parameters: MatcherParameters, pair: AnyPair) -> MatcherParameters:
    """With the search range of the pair."""
    return parameters.replace(min_disparity=pair.min_disparity, num_disparities=pair.num_disparities)


def pair_fingerprint(pair: AnyPair) -> str:
    """Changes with anything that figures of the pair follow from, except parameters and judge."""
    arrays = [pair.left, pair.right]
    if isinstance(pair, StereoScene):
        arrays += [pair.ground_truth, pair.nonocc]
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f'{array.dtype}{array.shape}'.encode())
        digest.update(array.tobytes())
    return digest.hexdigest()
