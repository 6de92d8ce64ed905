import numpy as np
import oracles
import pytest
import stages
from scenes import noise

from svdm_core import MatcherParameters
from svdm_core.disparity_optimization.penalties import Penalties, fill_penalties, p2_table
from svdm_core.kernels.stripes import block_count, rows_of


@pytest.mark.parametrize(('p1', 'p2', 'p2_edge'), [
    (7, 92.0, 20.0), (0, 92.0, 0.0), (30, 10.0, 20.0), (0, 0.0, 1.0), (255, 1e6, 5.0), (3, 1e6, 1000.0)])
def test_p2_is_halved_at_an_edge_of_p2_edge_and_between_p1_and_255(p1, p2, p2_edge):
    table = p2_table(p1, p2, p2_edge)
    assert table.dtype == np.uint8
    for edge in range(256):
        wanted = p2 / (1 + edge / p2_edge) if p2_edge else p2
        assert table[edge] == min(max(round(wanted), p1), 255)


@pytest.mark.parametrize('every', [1, 3])
@pytest.mark.parametrize('shape', [(1, 1), (37, 9), (7, 9, 3)])
def test_a_penalty_is_looked_up_by_the_edge_that_is_crossed(shape, every):
    pair = noise(*shape), noise(*shape, seed=1)
    rows = rows_of(shape, 1), rows_of(shape, every)
    tables = p2_table(3, 200.0, 60.0), p2_table(5, 90.0, 30.0)
    images = stages.images(*pair, MatcherParameters())
    across, down = np.full((2, 2, (shape[0] + 2) * shape[1]), 77, np.uint8)
    penalties = Penalties(np.uint8(3), np.uint8(5), *tables, across, down)
    stages.run(stages.task_phase(sum(block_count(part.height) for part in rows), fill_penalties, penalties,
                                 stages.edges(images, *rows), *rows))
    matched = pair[0], pair[1][rows[1].offset::rows[1].every, ::-1]
    for view, image in enumerate(matched):
        for found, edge in zip((across[view], down[view]), oracles.edges(image), strict=True):
            found = found[:edge.size].reshape(edge.shape)
            np.testing.assert_array_equal(found, tables[view][edge])
