import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import noise

from svdm_core.cost_aggregation.spanning_forest import SpanningTrees


def minimum_spanning_trees(left, right):
    trees = SpanningTrees.empty(left.shape)
    trees.build(right, left)  # another pair first: nothing of it may be left
    trees.build(left, right)
    return trees.pixel, trees.parent, trees.weight


def check_tree(guide, pixel, parent, weight):
    """Spans the grid, in an order that puts parents first, over edges of the grid, at the least total weight."""
    height, width = guide.shape[:2]
    nodes = height * width
    assert sorted(pixel.tolist()) == list(range(nodes))
    assert (pixel[0], parent[0], weight[0]) == (0, 0, 0)
    assert (parent[1:] < np.arange(1, nodes)).all() and (np.diff(parent) >= 0).all()
    edges = {frozenset((a, b)): w for w, a, b in oracles.grid_edges(guide)}
    for k in range(1, nodes):
        assert edges.get(frozenset((pixel[k], pixel[parent[k]]))) == weight[k]
    assert weight.sum(dtype=int) == oracles.spanning_tree_weight(guide)


@pytest.mark.parametrize('shape', [(1, 1), (1, 8), (8, 1), (7, 9), (7, 9, 3), (12, 5, 3)])
def test_both_views_get_a_minimum_spanning_tree(shape):
    guides = noise(*shape), noise(*shape, seed=1)
    trees = minimum_spanning_trees(*guides)
    for view, guide in enumerate(guides):
        check_tree(guide, *(part[view] for part in trees))


@settings(max_examples=40, deadline=None, derandomize=True)
@given(st.integers(1, 6), st.integers(1, 6), st.integers(1, 255), st.integers(0, 2**32 - 1))
def test_ties_and_constant_areas(height, width, step, seed):
    guide = (noise(height, width, seed=seed) // 86 * step).astype(np.uint8)
    trees = minimum_spanning_trees(guide, guide)
    check_tree(guide, *(part[0] for part in trees))


def test_a_falling_edge_weighs_its_height_and_does_not_wrap_round():
    _, _, weight = minimum_spanning_trees(np.array([[3, 0]], np.uint8), np.array([[0, 3]], np.uint8))
    assert weight.tolist() == [[0, 3], [0, 3]]


def test_an_edge_weighs_its_largest_channel():
    guide = np.zeros((1, 2, 3), np.uint8)
    guide[0, 1] = 5, 90, 20
    assert minimum_spanning_trees(guide, guide[..., ::-1])[2].tolist() == [[0, 90], [0, 90]]
