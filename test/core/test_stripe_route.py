"""How costs and penalties share the byte of a path cost."""
import numpy as np
import pytest
from scenes import noise

from svdm_core import load_preset
from svdm_core.kernels.stripes import rows_of
from svdm_core.matching_cost.byte_costs import largest_cost
from svdm_core.matching_cost.intensity_range import IntensityRange
from svdm_core.matching_cost.preparation import images_of
from svdm_core.stripe_route import StripeRoute

SHAPE = (20, 30)


def scaled(parameters):
    """(largest cost in bytes, largest P2) of both views, as the phases of a pair have them."""
    image = noise(*SHAPE)
    route = StripeRoute((*SHAPE, 1), parameters)
    images = images_of(image, image, IntensityRange.full(np.uint8), None)
    penalties = next(phase.arguments[0] for phase in route.phases(images, parameters)
                     if phase.run.__name__ == 'fill_penalties')
    pixel = [int(costs.outside.max()) for costs in route._costs(parameters)]
    full = [side.full_cost * cost / side.pixel_cost for side, cost in zip(route.sides, pixel, strict=True)]
    return list(zip(full, (int(penalties.p2_left.max()), int(penalties.p2_right.max())), strict=True))


@pytest.mark.parametrize('preset', ['default', 'fast', 'accurate'])
def test_the_costs_of_the_presets_are_as_fine_as_their_aggregation_has_them(preset):
    route = StripeRoute((*SHAPE, 1), load_preset(preset))
    assert route._costs(load_preset(preset))[0].outside.max() == route.sides[0].pixel_cost


@pytest.mark.parametrize('changes', [{'census_weight': 0.0}, {'p2': 5.0}, {'aggregation': 'box', 'p2': 3.0}])
def test_a_cost_and_p2_together_stay_in_a_byte(changes):
    parameters = load_preset('default').replace(**changes)
    assert parameters.p2 / largest_cost(parameters) > 2.9
    for full, p2 in scaled(parameters):
        assert 200 < full + p2 <= 255.5  # P2 is rounded


def test_rows_of_the_right_view_are_those_asked_for():
    route = StripeRoute((*SHAPE, 1), load_preset('default').replace(right_rows=4))
    assert route.right == rows_of(SHAPE, 4) and route.right.height == 5
