"""How parameters are moved: every one of the matcher's is there, every position is allowed."""
import pytest

from svdm_core import parameter_table
from svdm_core.parameters import STAGES
from svdm_core.tuning.ladders import by_importance
from svdm_ros.node.parameter_set import NodeParameters, node_parameter_table
from svdm_ros.tuner.controls import OWN_GROUP, controls, groups, written

TABLE = {info.name: info for info in node_parameter_table()}


def test_all_parameters_of_the_matcher_are_there_once_stage_by_stage():
    found = groups(controls())
    assert list(found) == [*STAGES, OWN_GROUP]
    names = [control.name for members in found.values() for control in members]
    assert len(set(names)) == len(names) and {info.name for info in parameter_table()} <= set(names)


def test_where_images_come_from_and_results_go_is_not_moved():
    names = {control.name for control in controls()}
    assert not names & {'input', 'transport', 'layout', 'queue_size', 'depth_encoding', 'point_stride', 'num_threads'}


def test_the_important_ones_come_first_and_the_rest_is_folded():
    order = by_importance()
    for group, members in groups(controls()).items():
        ranks = [order.index(control.name) for control in members if control.name in order]
        assert ranks == sorted(ranks)
        if group != OWN_GROUP:
            folded = [control.is_folded for control in members if control.name in order]
            assert folded == sorted(folded)
    seen = [control.name for control in controls() if not control.is_folded]
    assert {'p2', 'census_weight', 'num_disparities', 'confidence_threshold'} <= set(seen) and len(seen) < 20


@pytest.mark.parametrize('control', [one for one in controls() if one.kind == 'slider'], ids=lambda one: one.name)
def test_every_position_is_allowed_in_order_and_the_default_among_them(control):
    info = TABLE[control.name]
    assert list(control.positions) == sorted(control.positions) and 2 <= len(control.positions) <= 150
    assert all(type(value) is info.type and info.check(value) == value for value in control.positions)
    assert control.positions[control.position(info.default)] == info.default
    assert control.positions[0] == info.minimum or info.minimum > 0 or info.minimum < 0
    for place, value in enumerate(control.positions):
        assert control.position(value) == place
    assert control.position(control.positions[-1] * 2 + 1) == len(control.positions) - 1


def test_kinds_follow_from_types():
    kinds = {control.name: control.kind for control in controls()}
    assert (kinds['p2'], kinds['subpixel'], kinds['gradient'], kinds['roi']) == ('slider', 'switch', 'choice', 'text')


def test_sliders_reach_where_they_are_useful():
    places = {control.name: control.positions for control in controls()}
    assert {16, 64, 96, 128, 256, 1024} <= set(places['num_disparities'])
    assert places['w_p'] == tuple(range(1, 102, 2))
    assert places['sigma_tree'][0] <= 0.005 and places['sigma_tree'][-1] >= 0.1
    assert places['p2'][0] == 0 and any(1 < value < 1.5 for value in places['p2'])
    assert NodeParameters().replace({name: positions[-1] for name, positions in places.items()
                                     if positions and name != 'min_depth'})


def test_values_are_short():
    assert [written(value) for value in (True, False, 0.1 + 0.2, 2 / 255, 64, 'tree')] == [
        'on', 'off', '0.3', '0.007843', '64', 'tree']
