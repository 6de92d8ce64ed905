"""The node's parameters as dynamic ROS parameters."""
from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.node import Node
from rclpy.parameter import Parameter

from svdm_core import ParameterInfo
from svdm_core.shown import nearest, shown

from .parameter_set import NodeParameters, Value, checked_value, node_parameter_table

_NAMES = tuple(info.name for info in node_parameter_table())
_ROS_PARAMETERS = ('use_sim_time', 'start_type_description_service')
"""Names that rclpy declares itself."""
_SHOWN = 100
"""Characters of a name."""


_ELSEWHERE = {
    'approximate_sync': 'approximate_sync_tolerance',
    'approximate_sync_tolerance_seconds': 'approximate_sync_tolerance',
    'disparity_range': 'num_disparities', 'disp12_max_diff': 'tau_lr', 'P1': 'p1', 'P2': 'p2', 'sgbm_mode': 'paths',
    'stereo_algorithm': 'aggregation', 'correlation_window_size': 'aggregation',
    'uniqueness_ratio': 'uniqueness',
}
"""Parameters of stereo_image_proc's disparity_node, and what serves the same purpose here."""


def descriptor(info: ParameterInfo) -> ParameterDescriptor:
    """What rqt_reconfigure and `ros2 param describe` show; rclpy enforces type and range from it."""
    result = ParameterDescriptor(
        name=info.name,
        type=Parameter.Type.from_parameter_value(info.default).value,
        description=f'{info.meaning} [{info.unit}]' if info.unit else info.meaning,
        additional_constraints=f'one of: {info.allowed}' if info.choices else '',
    )
    if info.type is int:
        result.integer_range = [IntegerRange(from_value=info.minimum, to_value=info.maximum, step=info.step)]
    elif info.type is float:
        result.floating_point_range = [FloatingPointRange(from_value=info.minimum, to_value=info.maximum, step=0.0)]
    return result


class DeclaredParameters:
    """Declares the whole table on a node and keeps `current` in step with it.

    The node must have been made with automatically_declare_parameters_from_overrides: rclpy would refuse 1 for 1.0
    where it declares an override itself, and would not tell of a misspelt name.
    `on_change` is called with the new set after each change; `others` are names that somebody else will declare;
    `unknown` are those nobody will. Raises ValueError for a start-up value out of range.
    """

    def __init__(
        self, node: Node, on_change: Callable[[NodeParameters], None], others: Collection[str] = ()
    ) -> None:
        self._node = node
        self._on_change = on_change
        self.current = NodeParameters().replace(_take_overrides(node))
        self.unknown = tuple(_take_unknown(node, others))
        for info in node_parameter_table():
            node.declare_parameter(info.name, self.current.value(info.name), descriptor(info), ignore_override=True)
        node.add_pre_set_parameters_callback(self._checked)
        node.add_on_set_parameters_callback(self._validate)
        node.add_post_set_parameters_callback(self._apply)

    def _checked(self, changes: list[Parameter]) -> list[Parameter]:
        """Each value in its parameter's type, 1 for 1.0 as everybody types it; rclpy's own refusals tell too little."""
        return [self._checked_one(change) for change in changes]

    def _checked_one(self, change: Parameter) -> Parameter:
        info = next((info for info in node_parameter_table() if info.name == change.name), None)
        if info is not None:
            try:
                return Parameter(change.name, value=checked_value(info, change.value))
            except ValueError as error:
                raise _RefusedError(str(error)) from None
        if change.name.startswith('qos_overrides.'):
            raise _RefusedError(f'{shown(change.name, _SHOWN)} is read at the start only: start the node anew with it')
        if not self._node.has_parameter(change.name):
            raise _RefusedError(f'unknown parameter {shown(change.name, _SHOWN)}: {_hint(change.name)}')
        return change

    def _validate(self, changes: list[Parameter]) -> SetParametersResult:
        try:
            self.current.replace(_known(changes))
        except ValueError as error:
            return SetParametersResult(successful=False, reason=str(error))
        return SetParametersResult(successful=True)

    def _apply(self, changes: list[Parameter]) -> None:
        changed = self.current.replace(_known(changes))
        if changed != self.current:
            self.current = changed
            self._on_change(changed)


class _RefusedError(ParameterNotDeclaredException):
    """The one exception whose text rclpy's parameter services answer with; any other gives no answer at all."""

    def __init__(self, reason: str) -> None:
        Exception.__init__(self, reason)


def unknown_parameter_line(name: str, others: Collection[str] = ()) -> str:
    """What to say of a start-up parameter that nobody declares; `others` are names it may be meant for."""
    return f'unknown parameter {shown(name, _SHOWN)} is ignored: {_hint(name, others)}'


def _hint(name: str, others: Collection[str] = ()) -> str:
    if name in _ELSEWHERE:
        return f'that of stereo_image_proc is {_ELSEWHERE[name]} here, in a unit of its own (ros2 param describe)'
    near = nearest(name, [*_NAMES, *_ROS_PARAMETERS, *others])
    return f'did you mean {near}?' if near else 'ros2 param list tells the names'


def _known(changes: Iterable[Parameter]) -> dict[str, Value]:
    """The table's part of a change; use_sim_time and the like are not ours to judge."""
    return {change.name: change.value for change in changes if change.name in _NAMES}


def _take_overrides(node: Node) -> dict[str, Value]:
    """The start-up values of the table's parameters, undeclared again so that they can be declared in full."""
    given = {name: node.get_parameter(name).value for name in _NAMES if node.has_parameter(name)}
    for name in given:
        node.undeclare_parameter(name)
    return given


def _take_unknown(node: Node, others: Collection[str]) -> Iterator[str]:
    """The start-up parameters that belong to nobody, undeclared; to be called after `_take_overrides`."""
    for name in list(node.get_parameters_by_prefix('')):
        if name not in _ROS_PARAMETERS and name not in others:
            node.undeclare_parameter(name)
            yield name
