"""How each parameter is moved on the page: a slider over sensible positions, a switch, a choice, a text."""
from __future__ import annotations

import bisect
import math
from collections.abc import Mapping, Sequence
from typing import Literal, NamedTuple

from svdm_core import ParameterInfo
from svdm_core.parameters import STAGES
from svdm_core.tuning.ladders import by_importance

from ..node.parameter_set import Value, node_parameter_table

Kind = Literal['slider', 'switch', 'choice', 'text']

OWN_GROUP = 'before and after matching'
_OWN = ('confidence_threshold', 'speckle_size', 'temporal_filter', 'publish_filled', 'min_depth', 'max_depth',
        'downscale', 'exposure_match', 'align_rows', 'roi')
"""The node's parameters that change what is seen; all others say where images come from and where results go."""
_IMPORTANT = 10
"""So many parameters of the matcher are not folded away."""
_NEVER_FOLDED = ('num_disparities', 'confidence_threshold', 'speckle_size', 'temporal_filter')
_MOST_STEPS = 120
_MANTISSAS = (1.0, 1.2, 1.5, 1.8, 2.2, 2.7, 3.3, 4.0, 5.0, 6.0, 7.0, 8.0)
_DECADES = 2
"""Of a logarithmic slider, below and above its middle."""


class Control(NamedTuple):
    """One parameter on the page. group: where it stands. positions: of a slider, in order, the default among them.
    is_folded: whether it is seen only when it is looked for."""

    info: ParameterInfo
    kind: Kind
    group: str
    positions: tuple[Value, ...]
    is_folded: bool

    @property
    def name(self) -> str:
        return self.info.name

    def position(self, value: Value) -> int:
        """The place on the slider next to a value."""
        numbers = [float(position) for position in self.positions]
        after = bisect.bisect_left(numbers, float(value))
        around = [place for place in (after - 1, after) if 0 <= place < len(numbers)]
        return min(around, key=lambda place: abs(numbers[place] - float(value)))


def controls() -> list[Control]:
    """Of all parameters that change the picture, group by group, the most important of each group first."""
    order = {name: place for place, name in enumerate(by_importance())}
    matcher = sorted((info for info in node_parameter_table() if info.stage),
                     key=lambda info: (STAGES.index(info.stage), order.get(info.name, len(order))))
    own = {info.name: info for info in node_parameter_table()}
    important = (*_NEVER_FOLDED, *list(order)[:_IMPORTANT])
    return [Control(info, _kind(info), info.stage or OWN_GROUP, _positions(info), info.name not in important)
            for info in (*matcher, *(own[name] for name in _OWN))]


def groups(found: Sequence[Control]) -> Mapping[str, list[Control]]:
    """By group, in their order."""
    names = dict.fromkeys(control.group for control in found)
    return {name: [control for control in found if control.group == name] for name in names}


def written(value: Value) -> str:
    """A value as the page shows it."""
    if isinstance(value, bool):
        return 'on' if value else 'off'
    return f'{value:.4g}' if isinstance(value, float) else str(value)


def _kind(info: ParameterInfo) -> Kind:
    if info.choices:
        return 'choice'
    if info.type is bool:
        return 'switch'
    return 'text' if info.type is str else 'slider'


def _positions(info: ParameterInfo) -> tuple[Value, ...]:
    if info.type not in (int, float):
        return ()
    low, high, default = float(info.minimum or 0), float(info.maximum or 0), float(info.default)
    if info.type is int:
        step = max(info.step, 1)
        steps = range(int(low), int(high) + 1, step)
        return tuple(steps) if len(steps) <= _MOST_STEPS else _wide_integers(info)
    if high <= 1 and (default == 0 or default > high / 20):
        numbers = {round(low + (high - low) * place / 100, 6) for place in range(101)}
    else:
        middle = default or min(10.0, high / 10)
        numbers = {0.0, *_decades(middle)} if low <= 0 else set(_decades(middle))
    return tuple(sorted(number for number in {*numbers, default} if low <= number <= high))


def _decades(middle: float) -> list[float]:
    """About 12 round numbers a decade."""
    first, last = (math.floor(math.log10(middle)) + decades for decades in (-_DECADES, _DECADES))
    return [float(f'{mantissa}e{exponent}') for exponent in range(first, last) for mantissa in _MANTISSAS]


def _wide_integers(info: ParameterInfo) -> tuple[Value, ...]:
    """Integers that grow by a third to a half from one to the next, on either side of 0."""
    low, high = int(info.minimum or 0), int(info.maximum or 0)
    sizes = {int(mantissa * 2**power) for power in range(1, 21) for mantissa in (1.0, 1.5)}
    found = {low, high, int(info.default), 0, 1, *sizes, *(-size for size in sizes)}
    return tuple(sorted(number for number in found if low <= number <= high))
