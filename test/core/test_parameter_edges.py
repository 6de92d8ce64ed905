"""Values at the edges of the table: those allowed make the settings of the engine, others are refused in a line."""
import math

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from svdm_core import MatcherParameters, parameter_table
from svdm_core.cost_aggregation.exact_tree import edge_similarities
from svdm_core.disparity_refinement import byte_median, weighted_median
from svdm_core.matching_cost.float_costs import cost_scale
from svdm_core.stripe_route import StripeRoute

SHAPES = (2, 5), (2, 5, 3)
EDGES = (5e-324, 1e-320, 1e-300, 1e-12, 1e-3, 0.5)


def allowed(info):
    """All values of a parameter, the smallest of a float among them."""
    if info.type is bool:
        return st.booleans()
    if info.choices:
        return st.sampled_from(info.choices)
    if info.type is int:
        step = max(info.step, 1)
        return st.integers(0, (info.maximum - info.minimum) // step).map(lambda steps: info.minimum + steps * step)
    near_zero = [value for value in EDGES if info.minimum <= value <= info.maximum]
    ends = st.sampled_from([info.minimum, info.maximum, *near_zero])
    return st.floats(info.minimum, info.maximum) | ends


def settings_of(parameters, level_unit):
    """All that is computed from parameters before a kernel runs, for images of `level_unit` grey levels a level."""
    for shape in SHAPES:
        route = StripeRoute(shape, parameters)
        yield from (term for costs in route._costs(parameters) for term in costs[6:])
        penalties = route._penalties(parameters, level_unit)
        yield from (*penalties[:2], *penalties.p2_left, *penalties.p2_right)
    yield from cost_scale(parameters)
    yield from edge_similarities(parameters.sigma_tree, parameters.d_y, level_unit)
    yield from byte_median.median_window(
        8, parameters.w_p, parameters.sigma_s, parameters.sigma_c / level_unit, parameters.num_disparities).spatial
    yield from weighted_median._spatial_exponents(parameters.w_p, parameters.sigma_s).ravel()


@given(st.fixed_dictionaries({info.name: allowed(info) for info in parameter_table()}), st.floats(1e-3, 257.0))
@example({'p2_edge': 1e-320}, 1.0)
@example({'p2_edge': 5e-324}, 257.0)
@example({'tau_ad': 1e-320, 'tau_gm': 0.0, 'census_weight': 0.0}, 1.0)
@example({'census_weight': 5e-324, 'alpha': 0.0, 'tau_ad': 0.0, 'p1': 1000.0, 'p2': 1000.0}, 1.0)
@example({'sigma_tree': 0.001, 'sigma_s': 0.1, 'sigma_c': 0.001, 'w_p': 101}, 257.0)
def test_whatever_is_allowed_makes_settings_of_finite_numbers(values, level_unit):
    parameters = MatcherParameters().replace(**values)
    assert all(math.isfinite(value) for value in settings_of(parameters, level_unit))


def test_a_tiny_p2_edge_takes_p2_away_from_every_edge():
    for edge in (5e-324, 1e-320, 1e-9):
        parameters = MatcherParameters(p2_edge=edge)
        table = StripeRoute(SHAPES[0], parameters)._penalties(parameters, 257.0).p2_left
        assert table[0] > table[1] == table[255]


NUMBERS = [info for info in parameter_table() if info.type in (int, float)]
WRONG = (math.nan, math.inf, -math.inf, 1e308, -1e308, 10**400, -10**400, 10**5000, 2**63, 2**64, True, '1', None, 1j)


@pytest.mark.parametrize('info', NUMBERS, ids=lambda info: info.name)
def test_numbers_beyond_any_range_are_refused_in_one_line(info):
    for value in WRONG:
        with pytest.raises(ValueError) as refused:
            MatcherParameters().replace(**{info.name: value})
        assert str(refused.value).startswith(f'{info.name} = ') and str(refused.value).isprintable()
    for text in ('nan', 'inf', '-inf', '1e999', '1e308', '9' * 5000, '0x10', '', ' ', '1e', '\u0661', '1_000_0'):
        try:
            assert info.minimum <= info.parse(text) <= info.maximum
        except ValueError as error:
            assert str(error).isprintable() and len(str(error)) < 300
