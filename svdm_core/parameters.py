"""The one table of matcher parameters: name, type, default, range, unit and meaning.

The ROS parameter descriptors, the command line, the preset files and the README's table all come
from `MatcherParameters`; nothing else states a default or a range.
"""
from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any, cast

from .cost_aggregation import AGGREGATIONS
from .shown import nearest, shown

STAGES = ('matching_cost', 'cost_aggregation', 'disparity_optimization', 'disparity_refinement')
"""The four stages in their order, each a package."""
_SHOWN = 100
"""Characters of a value in a refusal, which is read in a small window."""


@dataclasses.dataclass(frozen=True, slots=True)
class ParameterInfo:
    """What is known of one parameter.

    `minimum` and `maximum` are inclusive and None where the type has no range; `step` is the
    distance between allowed values (0: any); `choices` lists the allowed strings. `stage`: which of STAGES reads it
    first, empty for a parameter of the node. `form`: what a text without choices has to look like.
    """

    name: str
    default: bool | int | float | str
    meaning: str
    unit: str = ''
    minimum: int | float | None = None
    maximum: int | float | None = None
    step: int = 0
    choices: tuple[str, ...] = ()
    stage: str = ''
    form: str = ''

    @property
    def type(self) -> type:
        """bool, int, float or str."""
        return type(self.default)

    @property
    def allowed(self) -> str:
        """The allowed values as a reader wants them: '1 to 1024', '1, 3, 5 ... 101', 'image | disparity'."""
        if self.choices:
            return ' | '.join(self.choices)
        if self.type is bool:
            return 'true | false'
        if self.form:
            return self.form
        if self.step > 1:
            values = range(int(self.minimum or 0), int(self.maximum or 0) + 1, self.step)
            return ', '.join(map(str, values)) if len(values) < 5 else f'{values[0]}, {values[1]} ... {values[-1]}'
        return f'{self.minimum} to {self.maximum}'

    def check(self, value: Any) -> bool | int | float | str:
        """`value` in the parameter's own type. Raises ValueError naming parameter, value and what is allowed."""
        if value is False and 'off' in self.choices:  # what YAML, and so ROS, makes of off without quotes
            value = 'off'
        converted = _converted(value, self.type)
        if converted is None or not self._holds(converted):
            unit = f' {self.unit}' if self.unit and not self.form else ''
            kind = {int: 'an integer, ', float: 'a number, '}.get(self.type, '')
            given = converted if isinstance(converted, int) else value  # 4, also where it was given as 4.0
            raise ValueError(f'{self.name} = {shown(given, _SHOWN)} is not allowed: it must be '
                             f'{kind}{self.allowed}{unit}')
        result: bool | int | float | str = converted
        return result

    def parse(self, text: str) -> bool | int | float | str:
        """The value `text` stands for on a command line: 31, 1e-3, true, filled. Raises ValueError as `check`."""
        if self.type is bool:
            return self.check({'true': True, 'false': False}.get(text.strip().lower(), text))
        if self.type is str:
            return self.check(text.strip())
        try:
            number = float(text)
        except ValueError:
            number = math.nan
        return self.check(number if math.isfinite(number) else text)

    def _holds(self, value: bool | int | float | str) -> bool:
        if self.choices:
            return value in self.choices
        if isinstance(value, bool | str):
            return True
        if self.minimum is None or self.maximum is None or not self.minimum <= value <= self.maximum:
            return False
        on_step = self.step <= 1 or (value - self.minimum) % self.step == 0
        return bool(on_step)


def _converted(value: Any, wanted: type) -> Any:
    """`value` as `wanted` where no meaning is lost (1 for 1.0, 31.0 for 31), else None."""
    if getattr(value, 'ndim', None) == 0:  # a number of numpy, which need not be imported for that
        value = value.item()
    if wanted in (bool, str):
        return value if isinstance(value, wanted) else None
    if isinstance(value, bool) or not isinstance(value, int | float):
        return None
    if wanted is int:
        return int(value) if isinstance(value, int) or value.is_integer() else None
    try:
        return float(value)
    except OverflowError:  # an integer of hundreds of digits
        return math.inf


def _parameter(default: bool | int | float | str, meaning: str, **info: Any) -> Any:
    return dataclasses.field(default=default, metadata={'meaning': meaning, **info})


@dataclasses.dataclass(frozen=True, slots=True)
class MatcherParameters:
    """Every setting of the four stages; symbols are the paper's. Immutable: `replace` gives a changed copy.

    Raises ValueError naming the parameter, its value and what is allowed.
    """

    min_disparity: int = _parameter(
        0, 'smallest disparity searched; below 0 for verged cameras', unit='px', minimum=-1024, maximum=1024,
        stage='matching_cost')
    num_disparities: int = _parameter(
        64, 'number of disparities searched, from min_disparity up', unit='px', minimum=1, maximum=1024,
        stage='matching_cost')
    intensity_range: str = _parameter(
        'pair', 'what intensities on 0..1 and grey levels refer to: the range that the pair itself uses, or the full '
        'range of its data type (the paper)', choices=('pair', 'full'), stage='matching_cost')
    gradient: str = _parameter(
        'horizontal', "gradient compared: signed x difference, halved, or the paper's magnitude (eq 5)",
        choices=('horizontal', 'magnitude'), stage='matching_cost')
    alpha: float = _parameter(
        10.7, 'weight of the gradient term against the absolute difference (eq 8)', minimum=0.0, maximum=1000.0,
        stage='matching_cost')
    tau_ad: float = _parameter(
        0.04, 'truncation of the absolute difference (eq 2), intensities on 0..1', minimum=0.0, maximum=1.0,
        stage='matching_cost')
    tau_gm: float = _parameter(
        2 / 255, 'truncation of the gradient difference (eq 7), intensities on 0..1', minimum=0.0, maximum=1.0,
        stage='matching_cost')
    census_weight: float = _parameter(
        0.5, 'weight of the census distance, the share of 7x5 neighbours that differ in order; 0 is off',
        minimum=0.0, maximum=1000.0, stage='matching_cost')
    aggregation: str = _parameter(
        'tree', 'support of a pixel: ', registry=AGGREGATIONS, stage='cost_aggregation')
    sigma_tree: float = _parameter(
        0.015, 'reach of the support along the tree, edge weights on 0..1', minimum=0.001, maximum=10.0,
        stage='cost_aggregation')
    d_y: int = _parameter(
        255, 'tree edges heavier than this are cut (eq 10); 255 cuts none', unit='grey levels', minimum=0, maximum=255,
        stage='cost_aggregation')
    guide_blur: int = _parameter(
        1, 'aperture of the median that smooths the image the tree is built on; 1 is off', unit='px',
        minimum=1, maximum=5, step=2, stage='cost_aggregation')
    subpixel: bool = _parameter(
        True, 'refine the winning disparity by the symmetric V through the costs of its neighbours',
        stage='disparity_optimization')
    p1: float = _parameter(
        0.07, 'semi-global penalty of a disparity step of 1 px between neighbours, in units of the matching cost',
        minimum=0.0, maximum=1000.0, stage='disparity_optimization')
    p2: float = _parameter(
        0.9, 'the same for larger steps; 0 switches semi-global optimisation off (the paper)',
        minimum=0.0, maximum=1000.0, stage='disparity_optimization')
    p2_edge: float = _parameter(
        20.0, 'step of the image over which p2 is halved, p2 / (1 + step / p2_edge); 0 leaves p2 as it is',
        unit='grey levels', minimum=0.0, maximum=1000.0, stage='disparity_optimization')
    paths: int = _parameter(
        4, 'semi-global paths: from the left, the right and above, and the fourth from below, which needs a volume',
        minimum=3, maximum=4, stage='disparity_optimization')
    right_rows: int = _parameter(
        2, 'the left-right check matches every n-th row of the right view; 1 is all rows', unit='rows',
        minimum=1, maximum=4, stage='disparity_optimization')
    tau_lr: float = _parameter(
        1.0, 'largest left-right difference of a valid disparity (eq 15)', unit='px', minimum=0.0, maximum=1024.0,
        stage='disparity_refinement')
    uniqueness: float = _parameter(
        0.09, 'by what share the smallest sum of path costs must lie below all others but its neighbours for a valid '
        'disparity; 0 is off, as it is where p2 is 0', minimum=0.0, maximum=1.0, stage='disparity_refinement')
    filling: str = _parameter(
        'far', 'what the left border and gaps at depth edges are filled with: the nearest valid disparity on the row '
        '(eq 16, the paper), or the weighted median of valid ones as far around as the search range is wide',
        choices=('scanline', 'far'), stage='disparity_refinement')
    median_scope: str = _parameter(
        'filled', 'pixels the weighted median replaces: those that failed the left-right check, or all (the paper)',
        choices=('filled', 'all'), stage='disparity_refinement')
    median_guide: str = _parameter(
        'image', 'what sigma_c compares (eq 17): the left image, or the disparity over num_disparities',
        choices=('image', 'disparity'), stage='disparity_refinement')
    w_p: int = _parameter(
        23, 'side of the weighted median window', unit='px', minimum=1, maximum=101, step=2,
        stage='disparity_refinement')
    sigma_s: float = _parameter(
        14.0, 'spatial reach of the weighted median (eq 17)', unit='px', minimum=0.1, maximum=1000.0,
        stage='disparity_refinement')
    sigma_c: float = _parameter(
        0.06, 'guide reach of the weighted median (eq 17), guide on 0..1', minimum=0.001, maximum=100.0,
        stage='disparity_refinement')
    final_median: int = _parameter(
        3, 'side of the plain median over the finished map, with its sub-pixel parts; 1 is off', unit='px',
        minimum=1, maximum=5, step=2, stage='disparity_refinement')
    plane_fit: bool = _parameter(
        True, 'move each disparity onto the plane through those around it that are near, alike and trusted',
        stage='disparity_refinement')

    def __post_init__(self) -> None:
        for info in parameter_table():
            object.__setattr__(self, info.name, info.check(getattr(self, info.name)))

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> MatcherParameters:
        """Defaults with `values` on top. Raises ValueError for an unknown name or a value out of range."""
        return cls().replace(**values)

    def replace(self, **values: Any) -> MatcherParameters:
        """A copy with `values` changed. Raises ValueError for an unknown name or a value out of range."""
        for name in values:
            parameter_info(name)
        return dataclasses.replace(self, **values)

    def as_dict(self) -> dict[str, bool | int | float | str]:
        """Name -> value, in table order."""
        return dataclasses.asdict(self)


def _info(field: dataclasses.Field[Any]) -> ParameterInfo:
    """The entry of a field; the choices of one with a registry are what is registered now."""
    metadata = dict(field.metadata)
    registry = metadata.pop('registry', None)
    if registry is not None:
        metadata['choices'] = tuple(registry)
        metadata['meaning'] += ', or '.join(entry.meaning for entry in registry.values())
    return ParameterInfo(name=field.name, default=cast(Any, field.default), **metadata)


_FIELDS = {field.name: field for field in dataclasses.fields(MatcherParameters)}
_FIXED = {name: _info(field) for name, field in _FIELDS.items() if 'registry' not in field.metadata}


def parameter_table() -> tuple[ParameterInfo, ...]:
    """All parameters in the order of the stages."""
    return tuple(_FIXED.get(name) or _info(field) for name, field in _FIELDS.items())


def parameter_info(name: str) -> ParameterInfo:
    """The entry of one parameter; ValueError with the nearest names where there is none."""
    if name in _FIELDS:
        return _FIXED.get(name) or _info(_FIELDS[name])
    near = nearest(name, _FIELDS)
    hint = f'did you mean {near}?' if near else 'known are ' + ', '.join(_FIELDS)
    raise ValueError(f'unknown parameter {shown(name, _SHOWN)}: {hint}')
