"""Requests to change parameters, in range and out of it, and what has to come of them."""
from __future__ import annotations

import functools
import random
from typing import Any

from svdm_core import ParameterInfo

from ..node.parameter_set import NodeParameters, checked_value, node_parameter_table

_TABLE = {info.name: info for info in node_parameter_table()}
KERNELS = frozenset((
    'num_disparities', 'aggregation', 'paths', 'subpixel', 'median_scope', 'median_guide', 'w_p', 'p2', 'min_depth',
    'num_threads', 'gradient', 'final_median', 'right_rows', 'guide_blur', 'p2_edge', 'census_weight', 'd_y'))
"""Another value may compile kernels for a minute, which take 80 to 110 MB for good: these are never changed, only asked
to be what they cannot be."""
_WRONG: tuple[Any, ...] = (float('nan'), float('inf'), -1e300, 2**62, -2**62, 'x' * 3000, '\x1b[2J\n', '', True, [1, 2],
                           ['a'], 1.5, [b'\x00', b'\xff'])
_UNKNOWN = ('alhpa', 'x' * 2000, 'qos_overrides./disparity.publisher.depth', 'roi ', 'Alpha', '\n')


def request(chance: random.Random) -> dict[str, Any]:
    """Names and values of one request, 1 to 5 of them; about half of the requests are as they should be."""
    names = chance.sample(sorted(_TABLE.keys() - KERNELS), chance.randint(1, 4))
    changes = {name: _value(chance, _TABLE[name]) for name in names}
    if chance.random() < 0.5:
        name = chance.choice(sorted(_TABLE))
        changes[name] = chance.choice(_wrong_values(name))
    if chance.random() < 0.05:
        changes[chance.choice(_UNKNOWN)] = chance.choice(_WRONG)
    return changes


def outcome(current: NodeParameters, changes: dict[str, Any]) -> NodeParameters | None:
    """The parameters after a request of all `changes` together; None where it has to be refused."""
    if not set(changes) <= set(_TABLE):
        return None
    try:
        return current.replace({name: checked_value(_TABLE[name], value) for name, value in changes.items()})
    except ValueError:
        return None


@functools.cache
def _wrong_values(name: str) -> list[Any]:
    """Those of _WRONG; some numbers among them are right for some parameters."""
    return [value for value in _WRONG if name not in KERNELS or outcome(NodeParameters(), {name: value}) is None]


def _value(chance: random.Random, info: ParameterInfo) -> Any:
    if info.choices:
        return chance.choice(info.choices)
    if info.type is bool:
        return chance.random() < 0.5
    if info.form:
        return chance.choice(('', '0, 0, 100, 100', '5 5 50 40'))
    assert info.minimum is not None and info.maximum is not None
    if info.type is int:
        return chance.randrange(int(info.minimum), int(info.maximum) + 1, max(info.step, 1))
    return chance.choice((info.minimum, info.maximum, chance.uniform(info.minimum, info.maximum)))
