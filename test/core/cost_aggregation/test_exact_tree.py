import numpy as np
import oracles
import pytest
from scenes import noise
from stages import ExactStage

from svdm_core import MatcherParameters
from svdm_core.cost_aggregation.exact_tree import edge_similarities, edge_similarity

FULL = MatcherParameters(intensity_range='full')


@pytest.mark.parametrize(('sigma_tree', 'd_y'), [(0.1, 255), (0.1, 40), (0.5, 255), (0.02, 0)])
@pytest.mark.parametrize('shape', [(1, 1), (1, 6), (5, 1), (7, 6)])
def test_every_node_gets_the_sum_over_all_paths(shape, sigma_tree, d_y):
    left, right = noise(*shape) // 2, noise(*shape, seed=1) // 2
    parameters = FULL.replace(num_disparities=20, sigma_tree=sigma_tree, d_y=d_y, tau_ad=0.5, tau_gm=0.5)
    stage = ExactStage(left, right, parameters)
    volume, cost = stage.volume(), stage.volume(isolated=True)
    trees = stage.trees
    for view in range(2):
        support = oracles.support(trees.parent[view], trees.weight[view], sigma_tree, d_y)
        by_node = cost[view].reshape(-1, 20)[trees.pixel[view]].astype(float)
        np.testing.assert_allclose(volume[view].reshape(-1, 20)[trees.pixel[view]], support @ by_node, rtol=2e-5)


def test_similarity_falls_with_weight_and_ends_at_the_cut():
    similarity = edge_similarity(np.arange(256, dtype=np.uint8), 0.1, 200)
    assert similarity[0] == 1 and (np.diff(similarity[:201]) < 0).all() and (similarity[201:] == 0).all()
    assert similarity[51] == pytest.approx(np.exp(-2), rel=1e-6)


def test_a_level_counts_as_many_grey_levels_as_the_range_says_and_255_cuts_none():
    assert edge_similarities(0.1, 90, 3.0)[[17, 30, 31]] == pytest.approx([np.exp(-2), np.exp(-90 / 25.5), 0])
    assert (edge_similarities(1.0, 255, 3.0) > 0).all()


def test_a_cut_keeps_two_regions_apart():
    left = np.array([[10, 10, 200, 200]], np.uint8)
    right = np.array([[10, 20, 200, 200]], np.uint8)
    parameters = FULL.replace(num_disparities=1, d_y=100, tau_ad=1.0, alpha=0.0, census_weight=0.0)
    assert ExactStage(left, right, parameters).volume()[0, 0, 2:, 0].tolist() == [0, 0]
    joined = ExactStage(left, right, parameters.replace(d_y=255)).volume()[0, 0, 2:, 0]
    assert (joined > 0).all()
