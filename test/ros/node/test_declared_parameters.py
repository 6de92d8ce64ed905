"""The table of the node's parameters as ROS descriptors and as one checked set."""
import dataclasses

import pytest
import rclpy
from hypothesis import given
from hypothesis import strategies as st
from rcl_interfaces.msg import ParameterType
from rclpy.exceptions import ParameterNotDeclaredException
from rclpy.parameter import Parameter
from rclpy.signals import SignalHandlerOptions

from svdm_core import parameter_table
from svdm_core.cost_aggregation import AGGREGATIONS, Aggregation
from svdm_ros.node.declared_parameters import DeclaredParameters, descriptor, unknown_parameter_line
from svdm_ros.node.parameter_set import NodeParameters, node_parameter_table

TABLE = node_parameter_table()
TYPES = {
    bool: ParameterType.PARAMETER_BOOL,
    int: ParameterType.PARAMETER_INTEGER,
    float: ParameterType.PARAMETER_DOUBLE,
    str: ParameterType.PARAMETER_STRING,
}
BOUNDED = [info for info in TABLE if info.minimum is not None]


def test_the_table_has_each_name_once():
    assert len({info.name for info in TABLE}) == len(TABLE)
    own_names = {info.name for info in TABLE} - {info.name for info in parameter_table()}
    assert own_names == {field.name for field in dataclasses.fields(NodeParameters)} - {'matcher'}


@pytest.mark.parametrize('info', TABLE, ids=lambda info: info.name)
def test_the_defaults_of_the_set_are_those_of_the_table(info):
    assert NodeParameters().value(info.name) == info.default


@pytest.mark.parametrize('info', TABLE, ids=lambda info: info.name)
def test_the_descriptor_tells_what_the_table_tells(info):
    described = descriptor(info)
    assert described.name == info.name
    assert described.type == TYPES[info.type]
    assert described.description.startswith(info.meaning)
    assert described.description.endswith(f'[{info.unit}]' if info.unit else info.meaning)
    assert not described.read_only
    assert all(choice in described.additional_constraints for choice in info.choices)
    ranges = {int: described.integer_range, float: described.floating_point_range}
    if info.type in ranges:
        (bounds,) = ranges[info.type]
        assert (bounds.from_value, bounds.to_value) == (info.minimum, info.maximum)
        assert bounds.step == info.step


def test_the_descriptor_tells_of_an_aggregation_registered_at_run_time(monkeypatch):
    monkeypatch.setitem(AGGREGATIONS, 'alone', Aggregation('nowhere:Alone', 'no other pixel'))
    described = descriptor(next(info for info in node_parameter_table() if info.name == 'aggregation'))
    assert described.additional_constraints == 'one of: tree | box | alone'
    assert described.description.endswith(', or no other pixel')


@pytest.mark.parametrize('info', BOUNDED, ids=lambda info: info.name)
@given(data=st.data())
def test_values_on_the_step_within_the_range_are_taken_and_no_others(info, data):
    if info.type is int:
        steps = (info.maximum - info.minimum) // max(info.step, 1)
        inside = info.minimum + data.draw(st.integers(0, steps)) * max(info.step, 1)
        outside = data.draw(st.one_of(st.integers(max_value=info.minimum - 1), st.integers(min_value=info.maximum + 1)))
    else:
        inside = data.draw(st.floats(info.minimum, info.maximum))
        beyond = st.floats(max_value=info.minimum, exclude_max=True) | st.floats(info.maximum, exclude_min=True)
        outside = data.draw(beyond | st.just(float('nan')))
    assert NodeParameters().replace({info.name: inside}).value(info.name) == inside
    with pytest.raises(ValueError) as refusal:
        NodeParameters().replace({info.name: outside})
    assert info.name in str(refusal.value)
    assert repr(outside) in str(refusal.value)
    assert info.allowed in str(refusal.value)


def test_a_change_leaves_the_old_set_and_the_other_values_alone():
    old = NodeParameters().replace({'alpha': 2.0, 'queue_size': 3})
    new = old.replace({'alpha': 5, 'baseline': 0.2})
    assert (old.matcher.alpha, old.baseline) == (2.0, 0.0)
    assert (new.matcher.alpha, new.baseline, new.queue_size) == (5.0, 0.2, 3)


def test_one_bad_value_refuses_the_whole_change():
    with pytest.raises(ValueError, match='w_p = 10 is not allowed'):
        NodeParameters().replace({'alpha': 2.0, 'w_p': 10, 'baseline': 0.2})


@given(st.floats(0, 10))
def test_the_tolerance_in_nanoseconds(seconds):
    parameters = NodeParameters(approximate_sync_tolerance=seconds)
    assert abs(parameters.tolerance_ns - seconds * 1e9) <= 0.5


def test_a_misspelt_name_is_told_with_the_nearest():
    assert unknown_parameter_line('alhpa') == "unknown parameter 'alhpa' is ignored: did you mean alpha?"
    assert 'ros2 param list' in unknown_parameter_line('frame_rate_of_camera')
    assert unknown_parameter_line('left.depht', ['left.depth']).endswith('did you mean left.depth?')


def test_the_names_of_stereo_image_proc_lead_to_those_here():
    line = unknown_parameter_line('disparity_range')
    assert 'that of stereo_image_proc is num_disparities here' in line


@pytest.mark.filterwarnings("ignore:module 'sre_")  # of the parser that rclpy's first node imports
def test_off_without_quotes_which_yaml_takes_for_false_is_off():
    context = rclpy.Context()
    rclpy.init(context=context, args=['--ros-args', '-p', 'align_rows:=off', '-p', 'exposure_match:=off'],
               signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node('camera', context=context, automatically_declare_parameters_from_overrides=True)
    try:
        assert node.get_parameter('align_rows').value is False  # so ROS reads it
        declared = DeclaredParameters(node, lambda _: None)
        assert (declared.current.align_rows, declared.current.exposure_match) == ('off', 'off')
        assert node.get_parameter('align_rows').value == 'off'
        for value, expected in (('track', 'track'), (False, 'off'), ('once', 'once')):
            [result] = node.set_parameters([Parameter('align_rows', value=value)])
            assert result.successful and declared.current.align_rows == expected
        with pytest.raises(ParameterNotDeclaredException, match='align_rows = True is not allowed'):
            node.set_parameters([Parameter('align_rows', value=True)])
    finally:
        node.destroy_node()
        context.shutdown()
