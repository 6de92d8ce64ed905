import numpy as np
import oracles
import pytest
from scenes import noise

from svdm_core.cost_aggregation import aggregate_blocks, edge_similarity
from svdm_core.matching_cost import BLOCK
from svdm_core.spanning_forest import minimum_spanning_trees


@pytest.mark.parametrize('blocks', [1, 3])
@pytest.mark.parametrize(('sigma_tree', 'd_y'), [(0.1, 255), (0.1, 40), (0.5, 255), (0.02, 0)])
@pytest.mark.parametrize('shape', [(1, 1), (1, 6), (5, 1), (7, 6)])
def test_every_node_gets_the_sum_over_all_paths(shape, sigma_tree, d_y, blocks):
    guides = noise(*shape) // 2, noise(*shape, seed=1) // 2
    _, parent, weight = minimum_spanning_trees(*guides)
    nodes = parent.shape[1]
    cost = np.random.default_rng(3).random((2, blocks, nodes, BLOCK), dtype=np.float32)
    expected = np.stack([
        oracles.support(parent[view], weight[view], sigma_tree, d_y) @ cost[view].astype(float) for view in range(2)
    ])
    aggregate_blocks(cost, parent, edge_similarity(weight, sigma_tree, d_y))
    np.testing.assert_allclose(cost, expected, rtol=2e-5)


def test_similarity_falls_with_weight_and_ends_at_the_cut():
    similarity = edge_similarity(np.arange(256, dtype=np.uint8), 0.1, 200)
    assert similarity[0] == 1 and (np.diff(similarity[:201]) < 0).all() and (similarity[201:] == 0).all()
    assert similarity[51] == pytest.approx(np.exp(-2), rel=1e-6)


def test_a_cut_keeps_two_regions_apart():
    guide = np.array([[10, 10, 200, 200]], np.uint8)
    pixel, parent, weight = minimum_spanning_trees(guide, guide)
    cost = np.zeros((2, 1, 4, BLOCK), np.float32)
    cost[:, 0, pixel[0] < 2] = 1
    aggregate_blocks(cost, parent, edge_similarity(weight, 0.1, 100))
    assert cost[0, 0, np.argsort(pixel[0]), 0].tolist() == [2, 2, 0, 0]
