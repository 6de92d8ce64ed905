import numpy as np
import oracles
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from svdm_core.disparity_optimization import Winners
from svdm_core.matching_cost import BLOCK


def blocks_of(volume, blocks):
    """volume (2, N, D) cut into what `update` takes: (first, count, (2, blocks, N, BLOCK)), padded with cost 0."""
    views, nodes, disparities = volume.shape
    step = blocks * BLOCK
    for first in range(0, disparities, step):
        count = min(step, disparities - first)
        part = np.zeros((views, nodes, step), np.float32)
        part[..., :count] = volume[..., first:first + count]
        yield first, count, np.ascontiguousarray(part.reshape(views, nodes, blocks, BLOCK).transpose(0, 2, 1, 3))


def optimise(volume, blocks=1, winners=None, subpixel=True):
    """(winner (2, N), vertex (N,)) of a volume (2, N, D), the nodes one row of pixels, the right view mirrored."""
    views, nodes, disparities = volume.shape
    winners = winners or Winners.empty(nodes)
    winners.reset()
    for first, count, cost in blocks_of(volume, blocks):
        winners.update(cost, first, count, subpixel)
    pixel = np.tile(np.arange(nodes, dtype=np.int32), (views, 1))
    winner, vertex = winners.images(pixel, (1, nodes), disparities)
    return np.stack([winner[0, 0], winner[1, 0, ::-1]]), vertex[0]


@settings(max_examples=60, deadline=None, derandomize=True)
@given(st.integers(1, 70), st.integers(1, 5), st.sampled_from([3, 1000]), st.integers(0, 2**32 - 1))
def test_winner_and_parabola_are_those_of_the_whole_volume(disparities, blocks, levels, seed):
    rng = np.random.default_rng(seed)
    volume = (rng.integers(0, levels, (2, 9, disparities)) / 8).astype(np.float32)  # few levels: many ties
    winner, vertex = optimise(volume, blocks)
    np.testing.assert_array_equal(winner, volume.argmin(axis=2))  # argmin takes the first of equals
    for node, d in enumerate(winner[0]):
        expected = oracles.parabola(*volume[0, node, d - 1:d + 2].astype(float)) if 0 < d < disparities - 1 else 0.0
        assert vertex[node] == pytest.approx(expected, abs=1e-6)


def test_nodes_go_to_their_pixels_and_the_right_view_is_mirrored_back():
    winners = Winners.empty(6)
    cost = np.ones((2, 1, 6, BLOCK), np.float32)
    cost[:, 0, np.arange(6), np.arange(6)] = 0  # node k wins at k
    winners.update(cost, 0, BLOCK)
    pixel = np.array([[3, 0, 5, 1, 4, 2], [0, 1, 2, 3, 4, 5]], np.int32)
    winner, _ = winners.images(pixel, (2, 3), BLOCK)
    assert winner[0].tolist() == [[1, 3, 5], [0, 4, 2]]
    assert winner[1].tolist() == [[2, 1, 0], [5, 4, 3]]


def test_a_second_frame_owes_nothing_to_the_first():
    rng = np.random.default_rng(5)
    first, second = rng.random((2, 2, 50, 40), dtype=np.float32)
    winners = Winners.empty(50)
    optimise(first / 100, 1, winners)
    again = optimise(second, 1, winners)
    fresh = optimise(second)
    np.testing.assert_array_equal(again[0], fresh[0])
    np.testing.assert_array_equal(again[1], fresh[1])


def test_without_subpixel_the_winners_are_the_same():
    volume = np.random.default_rng(6).random((2, 30, 50), dtype=np.float32)
    np.testing.assert_array_equal(optimise(volume, subpixel=False)[0], optimise(volume)[0])
