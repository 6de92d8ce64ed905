"""The parameter table of the README: `python -m svdm_ros.node.parameter_reference` prints it."""
from __future__ import annotations

from svdm_core import ParameterInfo

from .parameter_set import node_parameter_table


def markdown_table() -> str:
    """All parameters of the node as a Markdown table."""
    rows = ['| parameter | default | allowed | what it is |', '| --- | --- | --- | --- |']
    return '\n'.join(rows + [_row(info) for info in node_parameter_table()])


def _row(info: ParameterInfo) -> str:
    allowed = info.allowed.replace(' | ', ', ') + (f' {info.unit}' if info.unit and not info.form else '')
    return f'| `{info.name}` | {_short(info.default)} | {allowed} | {info.meaning} |'


def _short(value: bool | int | float | str) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    return f'{value:.4g}' if isinstance(value, float) else str(value)


if __name__ == '__main__':
    print(markdown_table())
