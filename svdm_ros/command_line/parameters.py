"""The parameters of a command that does offline what the node does live: a preset or a file, and --set."""
from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from svdm_core.presets import preset_values
from svdm_core.shown import cut, nearest, shown

from ..node.parameter_set import NodeParameters, Value, node_parameter_table

_NODE_ONLY = ('use_sim_time', 'qos_overrides')
"""What a parameter file of the node may hold besides, which means nothing offline."""


def node_parameters(source: str | Path, changes: Sequence[str] = ()) -> NodeParameters:
    """Of a preset or parameter file of the node, and of 'name=value' texts. ValueError names parameter, value and what
    is allowed."""
    table = {info.name: info for info in node_parameter_table()}
    values: dict[str, Value] = {}
    for name, value in preset_values(source).items():
        if name.partition('.')[0] in _NODE_ONLY:
            continue
        _check_known(name, table)
        values[name] = value
    for change in changes:
        name, equals, text = change.partition('=')
        if not equals:
            raise ValueError(f'--set {cut(change)} is not allowed: write it as name=value')
        _check_known(name, table)
        values[name] = table[name].parse(text)
    return NodeParameters().replace(values)


def _check_known(name: str, table: Mapping[str, Any]) -> None:
    if name not in table:
        near = nearest(name, table)
        raise ValueError(f'unknown parameter {shown(name, 100)}: ' + (
            f'did you mean {near}?' if near else f'known are {", ".join(table)}'))
