"""The node's parameters as a table and as one checked set: the matcher's and the node's own. Free of ROS."""
from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from typing import Any

from svdm_core import MatcherParameters, ParameterInfo, parameter_table

Value = bool | int | float | str

_OWN_TABLE = (
    ParameterInfo(
        'approximate_sync_tolerance', 0.0,
        'largest difference of the stamps of a pair; 0 pairs equal stamps only; keep it below half the frame period',
        unit='s', minimum=0.0, maximum=10.0),
    ParameterInfo(
        'queue_size', 10, 'images a side that wait for their partner', minimum=1, maximum=1000),
    ParameterInfo(
        'publish_filled', True,
        'publish a disparity for every pixel; false: only where the left-right check passed, the rest is invalid'),
    ParameterInfo(
        'baseline', 0.0, 'distance of the cameras, in place of the one in right/camera_info; 0 takes that one',
        unit='m', minimum=0.0, maximum=1000.0),
    ParameterInfo(
        'num_threads', 0, 'threads of the matcher; 0 is one a processor', minimum=0, maximum=1024),
)


def node_parameter_table() -> tuple[ParameterInfo, ...]:
    """All parameters of the node: the matcher's in the order of its stages, then the node's own."""
    return (*parameter_table(), *_OWN_TABLE)


_MATCHER_NAMES = frozenset(info.name for info in parameter_table())


@dataclasses.dataclass(frozen=True, slots=True)
class NodeParameters:
    """One consistent set. Immutable: whoever reads it between two frames has all of it, old or new.

    Raises ValueError naming the parameter, its value and what is allowed.
    """

    matcher: MatcherParameters = dataclasses.field(default_factory=MatcherParameters)
    approximate_sync_tolerance: float = 0.0
    queue_size: int = 10
    publish_filled: bool = True
    baseline: float = 0.0
    num_threads: int = 0

    def __post_init__(self) -> None:
        for info in _OWN_TABLE:
            object.__setattr__(self, info.name, info.check(getattr(self, info.name)))

    @property
    def tolerance_ns(self) -> int:
        """approximate_sync_tolerance in ns."""
        return round(self.approximate_sync_tolerance * 1e9)

    def replace(self, values: Mapping[str, Any]) -> NodeParameters:
        """A copy with `values` changed, checked as a set."""
        matcher = {name: value for name, value in values.items() if name in _MATCHER_NAMES}
        own = {name: value for name, value in values.items() if name not in _MATCHER_NAMES}
        return dataclasses.replace(self, matcher=self.matcher.replace(**matcher), **own)

    def value(self, name: str) -> Value:
        """The value of one parameter by its ROS name."""
        value: Value = getattr(self.matcher if name in _MATCHER_NAMES else self, name)
        return value
