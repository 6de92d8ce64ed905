"""The node's parameters as a table and as one checked set: the matcher's and the node's own. Free of ROS."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

from svdm_core import MatcherParameters, ParameterInfo, parameter_table
from svdm_core.shown import shown

Value = bool | int | float | str
_LONGEST_LIST = 16

_OWN_TABLE = (
    ParameterInfo(
        'input', 'rectified', 'whether the images are rectified, or raw: then they are rectified by camera_info',
        choices=('rectified', 'raw')),
    ParameterInfo(
        'transport', 'raw', 'images as they are, or compressed (JPEG, PNG): the topic is <image topic>/compressed',
        choices=('raw', 'compressed')),
    ParameterInfo(
        'layout', 'separate', 'an image of each camera, or one that holds both side by side: image_raw or image_rect',
        choices=('separate', 'side_by_side')),
    ParameterInfo(
        'approximate_sync_tolerance', 0.0,
        'largest difference of the stamps of a pair; 0 pairs equal stamps only; keep it below half the frame period',
        unit='s', minimum=0.0, maximum=10.0),
    ParameterInfo(
        'queue_size', 10, 'images queued per camera until their partner comes', minimum=1, maximum=1000),
    ParameterInfo(
        'publish_filled', True,
        'publish a disparity for every pixel; false: only where it is measured and confident enough, else invalid'),
    ParameterInfo(
        'baseline', 0.0, 'distance of the cameras, in place of the one in right/camera_info; 0 takes that one',
        unit='m', minimum=0.0, maximum=1000.0),
    ParameterInfo(
        'depth_encoding', '32FC1', 'depth in m, NaN where it is unknown (32FC1), or in mm, 0 where unknown (16UC1)',
        choices=('32FC1', '16UC1')),
    ParameterInfo(
        'point_stride', 1, 'points2 has every n-th pixel of every n-th row', minimum=1, maximum=64),
    ParameterInfo(
        'downscale', 1, 'images are shrunk by this factor before matching; all outputs have the small size',
        minimum=1, maximum=4),
    ParameterInfo(
        'roi', '', 'the part of the images that is matched: x, y, width, height; empty: all', unit='px',
        form='four integers such as 100, 50, 640, 400, or empty'),
    ParameterInfo(
        'min_depth', 0.0, 'nearest depth that is searched, in place of num_disparities; 0: off', unit='m', minimum=0.0,
        maximum=1000.0),
    ParameterInfo(
        'max_depth', 0.0, 'depths beyond are unknown; 0: off', unit='m', minimum=0.0, maximum=100000.0),
    ParameterInfo(
        'max_rate', 0.0, 'most pairs matched in a second, the newest; 0: no limit', unit='Hz', minimum=0.0,
        maximum=1000.0),
    ParameterInfo(
        'speckle_size', 0, 'regions of up to so many pixels that differ from all around are unknown; 0: off', unit='px',
        minimum=0, maximum=100000),
    ParameterInfo(
        'confidence_threshold', 0.2,
        'pixels of less confidence have no depth and no point; with publish_filled false no disparity either; 0: off',
        minimum=0.0, maximum=1.0),
    ParameterInfo(
        'temporal_filter', 0.0, 'weight of the past in the disparities, for a camera that stands or moves slowly; '
        '0: off; the result then depends on the frames before', minimum=0.0, maximum=0.95),
    ParameterInfo(
        'exposure_match', 'off', "whether the right image's brightness and contrast are brought to the left's",
        choices=('off', 'gain')),
    ParameterInfo(
        'align_rows', 'track', "whether the right image's rows are brought to the left's: by what the first pairs show "
        '(once), also by what later ones show (track), or not', choices=('off', 'once', 'track')),
    ParameterInfo(
        'num_threads', 0, 'threads of the matcher; 0: one thread per processor', minimum=0, maximum=1024),
)


def node_parameter_table() -> tuple[ParameterInfo, ...]:
    """All parameters of the node: the matcher's in the order of its stages, then the node's own."""
    return (*parameter_table(), *_OWN_TABLE)


class Region(NamedTuple):
    """A part of an image, px."""

    x: int
    y: int
    width: int
    height: int


_MATCHER_NAMES = frozenset(info.name for info in parameter_table())


@dataclasses.dataclass(frozen=True, slots=True)
class NodeParameters:
    """One consistent set. Immutable: whoever reads it between two frames has all of it, old or new.

    Raises ValueError naming the parameter, its value and what is allowed.
    """

    matcher: MatcherParameters = dataclasses.field(default_factory=MatcherParameters)
    input: str = 'rectified'
    transport: str = 'raw'
    layout: str = 'separate'
    approximate_sync_tolerance: float = 0.0
    queue_size: int = 10
    publish_filled: bool = True
    baseline: float = 0.0
    depth_encoding: str = '32FC1'
    point_stride: int = 1
    downscale: int = 1
    roi: str = ''
    min_depth: float = 0.0
    max_depth: float = 0.0
    max_rate: float = 0.0
    speckle_size: int = 0
    confidence_threshold: float = 0.2
    temporal_filter: float = 0.0
    exposure_match: str = 'off'
    align_rows: str = 'track'
    num_threads: int = 0

    def __post_init__(self) -> None:
        for info in _OWN_TABLE:
            object.__setattr__(self, info.name, checked_value(info, getattr(self, info.name)))
        _region(self.roi)
        if 0 < self.max_depth <= self.min_depth:
            raise ValueError(f'max_depth = {self.max_depth:g} is not allowed: it must be more than min_depth = '
                             f'{self.min_depth:g} m, or 0')

    @property
    def tolerance_ns(self) -> int:
        """approximate_sync_tolerance in ns."""
        return round(self.approximate_sync_tolerance * 1e9)

    @property
    def period(self) -> float:
        """Least time between the beginnings of two pairs, s."""
        return 1 / self.max_rate if self.max_rate > 0 else 0.0

    @property
    def region(self) -> Region | None:
        """What roi says; None: the whole image."""
        return _region(self.roi)

    def replace(self, values: Mapping[str, Any]) -> NodeParameters:
        """A copy with `values` changed, checked as a set."""
        matcher = {name: value for name, value in values.items() if name in _MATCHER_NAMES}
        own = {name: value for name, value in values.items() if name not in _MATCHER_NAMES}
        return dataclasses.replace(self, matcher=self.matcher.replace(**matcher), **own)

    def value(self, name: str) -> Value:
        """The value of one parameter by its ROS name."""
        value: Value = getattr(self.matcher if name in _MATCHER_NAMES else self, name)
        return value


def checked_value(info: ParameterInfo, value: Any) -> Value:
    """As `info.check`; a text that has to have a form may also be given as a list of integers."""
    is_short = isinstance(value, Sequence) and len(value) <= _LONGEST_LIST
    if info.form and is_short and all(isinstance(part, int) for part in value):
        value = ', '.join(map(str, value))
    return info.check(value)


def _region(roi: str) -> Region | None:
    """What the parameter roi says; None: the whole image. Raises ValueError naming it."""
    text = roi.strip().removeprefix('[').removesuffix(']')
    if not text.strip():
        return None
    numbers = text.replace(',', ' ').split()
    if len(numbers) != 4 or not all(number.isascii() and number.isdigit() and len(number) < 7 for number in numbers):
        raise ValueError(f'roi = {shown(roi, 100)} is not allowed: it must be {_form("roi")}')
    region = Region(*map(int, numbers))
    if not region.width or not region.height:
        raise ValueError(f'roi = {shown(roi, 100)} is not allowed: its width and height must be 1 or more')
    return region


def _form(name: str) -> str:
    return next(info.form for info in _OWN_TABLE if info.name == name)
