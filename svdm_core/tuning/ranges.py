"""What to vary: `alpha=10:11:0.1` or `w_p=11,21,31`."""
from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence
from decimal import Decimal, DecimalException

from ..evaluation.paper import PAPER_STUDY
from ..parameters import parameter_info

MAX_VALUES = 1000

Value = bool | int | float | str


@dataclasses.dataclass(frozen=True, slots=True)
class ParameterRange:
    """A parameter and the values it is to take, in order, each of them allowed."""

    name: str
    values: tuple[Value, ...]

    @property
    def numeric(self) -> bool:
        """Whether the values lie on an axis."""
        return parameter_info(self.name).type in (int, float)


def parse_range(text: str) -> ParameterRange:
    """`name=first:last:step`, with a step that leads from first to last, or `name=value,value`.

    Values are computed in decimals: 10:11:0.1 ends with 11 and holds 10.3, not 10.299999999999999. Where no step falls
    on `last`, the range ends before it. ValueError with one line.
    """
    name, separator, values = text.partition('=')
    if not separator or not values:
        raise ValueError(f'{text!r} is not a range: write it as alpha=10:11:0.1 or w_p=11,21,31')
    info = parameter_info(name)
    check_tunable([name])
    parts = values.split(':')
    if len(parts) == 1:
        return ParameterRange(name, _distinct(text, [info.parse(value) for value in values.split(',')]))
    if len(parts) != 3 or info.type not in (int, float):
        raise ValueError(f'{text!r} is not a range: '
                         f'write {"first:last:step" if info.type in (int, float) else "the values as a,b"}')
    return ParameterRange(name, _distinct(text, [info.check(float(value)) for value in _steps(text, parts)]))


def paper_ranges() -> list[ParameterRange]:
    """The ranges of the paper's Tables 2 to 5."""
    return [ParameterRange(table.parameter, table.values) for table in PAPER_STUDY]


def check_tunable(names: Iterable[str]) -> None:
    """ValueError where one of `names` is not a setting but a property of the scene."""
    for name in names:
        if name in ('min_disparity', 'num_disparities'):
            raise ValueError(f'{name} cannot be set here: each scene has its own')


def once_each(ranges: Sequence[ParameterRange]) -> None:
    """ValueError where a parameter has two ranges, which a joint search cannot have."""
    names = [entry.name for entry in ranges]
    for name in names:
        if names.count(name) > 1:
            raise ValueError(f'{name} is varied twice: a joint search takes one range a parameter')


def _decimal(text: str) -> Decimal | None:
    """The finite number `text` is, else None."""
    try:
        value = Decimal(text.strip())
    except DecimalException:
        return None
    return value if value.is_finite() else None


def _steps(text: str, parts: list[str]) -> list[Decimal]:
    first, last, step = map(_decimal, parts)
    if first is None or last is None or step is None:
        raise ValueError(f'{text!r} is not a range: {", ".join(parts)} are not three numbers')
    if step == 0 or (last - first) * step < 0:
        raise ValueError(f'{text!r} never ends: a step of {step} does not lead from {first} to {last}')
    count = (last - first) / step + 1
    if count >= MAX_VALUES + 1:
        raise ValueError(f'{text!r} has more than {MAX_VALUES} values')
    return [first + step * i for i in range(int(count))]


def _distinct(text: str, values: list[Value]) -> tuple[Value, ...]:
    if len(set(values)) != len(values):
        raise ValueError(f'{text!r} has a value twice')
    return tuple(values)
