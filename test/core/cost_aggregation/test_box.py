import numba
import numpy as np
import oracles
import pytest
from scenes import noise
from stages import ByteStage

from svdm_core import MatcherParameters
from svdm_core.cost_aggregation.box import PIXEL_COST, box_row
from svdm_core.kernels.stripes import Rows, rows_of


@numba.njit
def all_rows(costs, view, rows, first, ring, volume, lanes):
    known = max(0, first - 1)
    for y in range(first, rows.height):
        known = box_row(costs, view, rows, y, known, ring, volume[y], lanes)


def boxes_of(stage, view, rows, first=0):
    """uint8 (rows, W, lanes), from row `first` on."""
    volume = np.full((rows.height, rows.width * stage.width), 99, np.uint8)
    ring = np.full((3, rows.width * stage.width), 99, np.uint8)
    all_rows(stage.costs, view, rows, first, ring, volume, stage.lanes)
    return volume.reshape(rows.height, rows.width, -1)


def expected_boxes(stage, view, rows):
    before, width = stage.planes.before, rows.width
    census = stage.planes.census[:, rows.offset::rows.every, :, before:before + width]
    values = stage.planes.values[:, :, rows.offset::rows.every, before:before + width]
    return oracles.box_bytes(oracles.byte_cost(values[view], values[1 - view][..., ::-1], census[view],
                                               census[1 - view][..., ::-1], stage.costs, stage.width, PIXEL_COST))


@pytest.mark.parametrize('weights', [{}, {'tau_ad': 0.0, 'alpha': 0.0}])
@pytest.mark.parametrize(('shape', 'count', 'every'), [
    ((1, 1), 1, 1), ((1, 12), 20, 1), ((2, 1), 3, 1), ((3, 2), 33, 1), ((9, 30), 32, 1), ((9, 30), 20, 2),
    ((8, 9, 3), 5, 3),
])
def test_boxes_are_a_quarter_of_nine_costs_cut_off(shape, count, every, weights):
    parameters = MatcherParameters(num_disparities=count, min_disparity=-2, **weights)
    stage = ByteStage(noise(*shape) // 8, noise(*shape, seed=1) // 8, parameters, PIXEL_COST)
    rows = rows_of(shape, every)
    for view in range(2):
        np.testing.assert_array_equal(boxes_of(stage, view, rows), expected_boxes(stage, view, rows))


def test_boxes_may_begin_in_any_row():
    stage = ByteStage(noise(9, 12), noise(9, 12, seed=1), MatcherParameters(num_disparities=20), PIXEL_COST)
    rows = Rows(9, 12, 1, 0)
    whole = boxes_of(stage, 0, rows)
    for first in (1, 4, 8):
        np.testing.assert_array_equal(boxes_of(stage, 0, rows, first)[first:], whole[first:])
