import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svdm_core import MatcherParameters, parameter_info, parameter_table
from svdm_core.parameters import STAGES

RANGED = [info for info in parameter_table() if info.minimum is not None]


def test_every_field_has_an_entry_with_meaning_and_range_or_choices():
    assert [info.name for info in parameter_table()] == [field.name for field in dataclasses.fields(MatcherParameters)]
    for info in parameter_table():
        assert info.meaning and info.allowed
        assert info.type is bool or info.choices or info.minimum < info.maximum
        assert info.stage in STAGES
        assert info.check(info.default) == info.default


def test_the_table_is_in_the_order_of_the_stages():
    """Stage 4 reads the left-right check's threshold and what comes behind it: nothing else may be refined anew."""
    stages = [info.stage for info in parameter_table()]
    assert stages == sorted(stages, key=STAGES.index)
    assert [info.name for info in parameter_table() if info.stage == STAGES[-1]] == [
        'tau_lr', 'uniqueness', 'filling', 'median_scope', 'median_guide', 'w_p', 'sigma_s', 'sigma_c', 'final_median',
        'plane_fit']


@pytest.mark.parametrize('info', RANGED, ids=lambda info: info.name)
def test_both_ends_of_a_range_are_allowed_and_nothing_beyond(info):
    for end in (info.minimum, info.maximum):
        assert getattr(MatcherParameters(**{info.name: end}), info.name) == end
    for beyond in (info.minimum - 1, info.maximum + 1, math.nan, math.inf, -math.inf):
        with pytest.raises(ValueError, match=f'^{info.name} = .*{info.minimum}.*{info.maximum}'):
            MatcherParameters(**{info.name: beyond})


@pytest.mark.parametrize(('name', 'value'), [
    ('w_p', 4), ('w_p', -3), ('w_p', 31.5), ('guide_blur', 2), ('num_disparities', 0), ('num_disparities', True),
    ('num_disparities', '64'), ('sigma_s', 0), ('sigma_c', 0.0), ('sigma_tree', -1), ('tau_ad', -0.1), ('tau_lr', None),
    ('gradient', 'vertical'), ('gradient', 1), ('median_scope', ''), ('subpixel', 1), ('subpixel', 'true'),
    ('alpha', [1.0]), ('alpha', np.zeros(3)),
])
def test_a_refusal_names_parameter_value_and_what_is_allowed(name, value):
    with pytest.raises(ValueError) as refusal:
        MatcherParameters().replace(**{name: value})
    text = str(refusal.value)
    assert text.startswith(f'{name} = {value!r} ') and parameter_info(name).allowed in text and '\n' not in text


def test_an_unknown_name_is_refused_with_the_nearest_one():
    with pytest.raises(ValueError, match=r"unknown parameter 'sigma_x': did you mean sigma_[sc]\?"):
        MatcherParameters.from_mapping({'sigma_x': 1.0})


@given(st.integers(-2000, 2000))
def test_numbers_come_out_in_the_declared_type(value):
    for given_value in (value, float(value), np.int32(value), np.float32(value)):
        for name in ('num_disparities', 'alpha'):
            info = parameter_info(name)
            if info.minimum <= value <= info.maximum:
                checked = info.check(given_value)
                assert checked == value and type(checked) is info.type
            else:
                with pytest.raises(ValueError, match=name):
                    info.check(given_value)


def test_replace_leaves_the_original_and_the_rest_alone():
    before = MatcherParameters()
    after = before.replace(alpha=3)
    assert (before.alpha, after.alpha) == (10.7, 3.0)
    assert after.as_dict() == {**before.as_dict(), 'alpha': 3.0}
    with pytest.raises(dataclasses.FrozenInstanceError):
        after.alpha = 4.0
