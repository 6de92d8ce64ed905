"""A new aggregation is a class and a line in the registry: everything else takes its name and meaning from there."""
import numba
import numpy as np
import pytest
from scenes import shifted_wall

from svdm_core import MatcherParameters, StereoMatcher, load_preset, parameter_info, parameter_table
from svdm_core.commands.cli import main
from svdm_core.cost_aggregation import AGGREGATIONS, Aggregation
from svdm_core.cost_aggregation.aggregation import StripeAggregation
from svdm_core.kernels.tasks import share
from svdm_core.kernels.vectors import pointer
from svdm_core.kernels.wide import UNIT, store_wide
from svdm_core.matching_cost.byte_costs import cost_at, cost_row
from svdm_core.phases import Phase
from svdm_ros.node.parameter_reference import markdown_table


@numba.njit
def copy_row(y, _arena, costs, view, rows, lanes, volume):
    """The costs of each pixel alone."""
    row = cost_row(costs, view, rows.offset + rows.every * y, rows.width, 0)
    to, behind = pointer(volume), pointer(costs.behind)
    for x in range(rows.width):
        store_wide(to, (y * rows.width + x) * UNIT * len(lanes), cost_at(row, x, behind, lanes))


@numba.njit
def copy_costs(counter, end, arenas, costs, view, rows, lanes, volume):
    """A row a task."""
    share(copy_row, counter, end, arenas, (costs, view, rows, lanes, volume))


class AloneAggregation(StripeAggregation):
    """No support: each pixel's own costs."""

    pixel_cost = 64
    full_cost = 64.0

    def phases(self, costs, pair, parameters):
        rows = self.view.rows
        return [Phase('cost_aggregation', rows.height, copy_costs,
                      (costs, self.view.number, rows, (0,) * (self.view.lanes // UNIT), self.volume))]


@pytest.fixture
def alone(monkeypatch):
    monkeypatch.setitem(AGGREGATIONS, 'alone', Aggregation(f'{__name__}:AloneAggregation', 'no other pixel'))


@pytest.mark.parametrize('right_rows', [1, 2])
@pytest.mark.parametrize('paths', [3, 4])
def test_it_finds_a_shifted_wall(alone, paths, right_rows):
    left, right = shifted_wall(40, 70, 5)
    parameters = MatcherParameters(num_disparities=20, w_p=7, aggregation='alone', paths=paths, right_rows=right_rows)
    result = StereoMatcher(parameters).compute(left, right)
    inside = np.s_[4:-4, 9:-4]
    assert np.abs(result.disparity[inside] - 5).max() <= 0.5 and result.valid[inside].mean() > 0.95
    assert result.timings['cost_aggregation'] > 0


def test_presets_and_the_command_line_take_it(alone, tmp_path):
    import cv2

    preset = tmp_path / 'alone.yaml'
    preset.write_text('/**:\n  ros__parameters: {aggregation: alone, num_disparities: 20}\n')
    parameters = load_preset(preset)
    assert parameters.aggregation == 'alone'
    left, right = shifted_wall(40, 70, 5)
    for name, image in (('left', left), ('right', right)):
        cv2.imwrite(str(tmp_path / f'{name}.png'), image)
    pair = [str(tmp_path / 'left.png'), str(tmp_path / 'right.png')]
    expected = StereoMatcher(parameters).compute(left, right).disparity
    for number, options in enumerate((['--params', str(preset)], ['--set', 'aggregation=alone', 'num_disparities=20'])):
        output = tmp_path / f'{number}.npy'
        assert main(['match', *pair, *options, '-o', str(output)]) == 0
        np.testing.assert_array_equal(np.load(output), expected)


def test_the_table_describes_it_as_long_as_it_is_there(alone, monkeypatch):
    info = parameter_info('aggregation')
    assert info in parameter_table() and info.choices == tuple(AGGREGATIONS) and info.choices[-1] == 'alone'
    assert '| tree | tree, box, alone |' in markdown_table()
    assert info.allowed.endswith(' | alone') and info.meaning.endswith(', or no other pixel')
    monkeypatch.delitem(AGGREGATIONS, 'alone')
    with pytest.raises(ValueError, match=r"aggregation = 'alone' is not allowed: it must be tree \| box$"):
        MatcherParameters(aggregation='alone')


def test_every_registered_class_is_an_aggregation():
    for entry in AGGREGATIONS.values():
        assert issubclass(entry.load(), StripeAggregation) and entry.meaning
