"""Which pairs of a recording to tune on: few, and as different as they come."""
from __future__ import annotations

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import cv2
import numpy as np

from ..evaluation.pair_folders import PairSource
from ..evaluation.reconstruction import textured_share
from ..kernels.arrays import Float32, Image
from ..row_alignment.alignment import RowAlignment
from ..row_alignment.estimation import estimate_row_alignment
from ..row_alignment.measurement import grey_of
from .image_pair import ImagePair

FEWEST = 5
"""Pairs; with fewer, a choice by `loss` is off by three times as much."""
_LITTLE = 15.0
"""%, of the pixels that have texture: below, most of a map is guesses that nothing in the images speaks against."""
_CANDIDATES = 5
"""Pairs looked at for each that is chosen."""
_MOST_BYTES = 2 * 2**30
"""Of the images of all that is looked at; larger ones are fewer."""
_MOST_DISPARITIES = 1024
_TINY = (16, 12)
"""px, of the thumbnails by which pairs are compared."""
_TIME = 40.0
"""Grey levels: what the whole length of a recording counts as much as."""


class ChosenPairs(NamedTuple):
    """notes: what should be known of them, a line each. rows: by what the right images of each source were aligned,
    None where there was nothing to correct; empty where that was not asked for."""

    pairs: list[ImagePair]
    notes: list[str]
    rows: dict[str, RowAlignment | None]


class _Candidate(NamedTuple):
    pair: ImagePair
    textured: float
    features: Float32


def choose_pairs(
    sources: Sequence[PairSource], count: int, search: tuple[int, int | None], *, align_rows: bool = False,
) -> ChosenPairs:
    """Up to `count` pairs: the one with the most texture, then always the one that is least like all before, in what it
    shows and in time; those without texture only where there are no others. The same ones every time.

    search: min_disparity, and num_disparities where it is not what a source says or a fifth of the width. align_rows:
    estimate how far the rows of each source are apart, from all pairs looked at, and align the right images. Raises
    ValueError where a source cannot be read.
    """
    each = -(-_CANDIDATES * count // len(sources))
    candidates, rows = [], {}
    for source in sources:
        pairs = _pairs(source, each, search)
        if align_rows:
            pairs, rows[source.name] = _aligned(pairs)
        candidates += [_Candidate(pair, textured_share(pair.left), _features(pair.left, number / len(pairs)))
                       for number, pair in enumerate(pairs)]
    chosen = _spread(candidates, count)
    notes = [note for source in sources for note in source.notes]
    if len(chosen) < FEWEST:
        notes.append(f'only {len(chosen)} {"pair" if len(chosen) == 1 else "pairs"}: a choice takes {FEWEST} or more, '
                     'as different as the camera will see; take what comes out with care')
    share = float(np.mean([candidate.textured for candidate in chosen]))
    if share < _LITTLE:
        notes.append(f'only {share:.0f} % of the pixels have texture: what comes out says little; take pairs that show '
                     'more')
    return ChosenPairs([candidate.pair for candidate in chosen], notes, rows)


def _pairs(source: PairSource, most: int, search: tuple[int, int | None]) -> list[ImagePair]:
    first = next(iter(source.read(1)))
    most = max(1, min(most, _MOST_BYTES // (first[0].nbytes + first[1].nbytes)))
    pairs = list(source.read(most))
    found = []
    for number, (left, right) in enumerate(pairs, 1):
        if left.shape != right.shape or left.dtype != right.dtype:
            raise ValueError(f'{source.name}: left image {left.shape} {left.dtype} and right image {right.shape} '
                             f'{right.dtype} must have the same shape and dtype')
        count = search[1] or source.num_disparities or min(max(16, left.shape[1] // 5), _MOST_DISPARITIES)
        name = source.name if len(pairs) == 1 else f'{source.name} {number}/{len(pairs)}'
        found.append(ImagePair(name, left, right, search[0], count))
    return found


def _aligned(pairs: list[ImagePair]) -> tuple[list[ImagePair], RowAlignment | None]:
    rows = estimate_row_alignment([(pair.left, pair.right) for pair in pairs], *pairs[0][3:])
    return pairs if rows is None else [pair._replace(right=rows.apply(pair.right)) for pair in pairs], rows


def _features(image: Image, time: float) -> Float32:
    """What two pairs are compared by; the distance of two is in grey levels, root mean square."""
    thumbnail = cv2.resize(grey_of(image), _TINY, interpolation=cv2.INTER_AREA).astype(np.float32)
    return np.append(thumbnail.ravel() / np.float32(np.sqrt(thumbnail.size)), np.float32(_TIME * time))


def _spread(candidates: Sequence[_Candidate], count: int) -> list[_Candidate]:
    """In the order of the candidates."""
    textured = [candidate for candidate in candidates if candidate.textured >= _LITTLE / 3]
    pool = textured or list(candidates)
    first = max(range(len(pool)), key=lambda place: pool[place].textured)
    chosen = [first]
    nearest = np.full(len(pool), np.inf)
    for _ in itertools.repeat(None, min(count, len(pool)) - 1):
        apart = [float(np.linalg.norm(candidate.features - pool[chosen[-1]].features)) for candidate in pool]
        nearest = np.minimum(nearest, apart)
        nearest[chosen] = -1.0
        chosen.append(int(nearest.argmax()))
    return [pool[place] for place in sorted(chosen)]
