"""Overrides of QoS: whatever makes none is told at the start, of topics in use and of others."""
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rclpy.qos import HistoryPolicy, ReliabilityPolicy

from svdm_ros.node.quality_of_service import check_overrides, override_names

NAMES = [*override_names('/disparity', 'publisher'), *override_names('/left/image_raw/compressed', 'subscription')]
GOOD = {'history': ['keep_last', 'keep_all', 'KEEP_LAST'], 'depth': [0, 1, 100], 'durability': ['volatile'],
        'reliability': ['reliable', 'best_effort', 'Best_Available', 'system_default']}
BAD = {'history': ['all', 'unknown', 3], 'depth': [-1, 2**31, 1.5, True, 'few', [1]], 'durability': ['latched', None],
       'reliability': ['sloppy', '', True, 'reliable ', 'get_value', 'reliable' * 1000]}


def test_every_policy_that_can_be_overridden_is_checked():
    assert {name.rpartition('.')[2] for name in NAMES} == set(GOOD) == set(BAD)


@given(st.data())
def test_values_that_make_a_qos_are_taken_and_all_others_told_in_one_line(data):
    good = {name: data.draw(st.sampled_from(GOOD[name.rpartition('.')[2]])) for name in NAMES}
    check_overrides(good)
    wrong = data.draw(st.sets(st.sampled_from(NAMES), min_size=1))
    bad = {name: data.draw(st.sampled_from(BAD[name.rpartition('.')[2]])) for name in wrong}
    with pytest.raises(ValueError) as refusal:
        check_overrides(good | bad)
    told = str(refusal.value)
    assert '\n' not in told and len(told) < 400 * len(wrong)
    assert all((f'{name} = ' in told) == (name in wrong) for name in NAMES)


def test_the_names_of_enumerations_are_those_of_rclpy():
    with pytest.raises(ValueError) as refusal:
        check_overrides({NAMES[0]: 'x', NAMES[2]: 'y'})
    for policy in (HistoryPolicy.KEEP_LAST, HistoryPolicy.KEEP_ALL, ReliabilityPolicy.RELIABLE):
        assert policy.name.lower() in str(refusal.value)
