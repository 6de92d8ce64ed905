import numpy as np
import oracles
import pytest
from scenes import noise
from stages import Stages
from svdm_core.cost_aggregation.tree import ForestNodes, aggregate_volume

from svdm_core import MatcherParameters, StereoMatcher
from svdm_core.disparity_optimization.penalties import fill_penalties, penalties_shape
from svdm_core.disparity_optimization.semiglobal import (
    LARGEST,
    cost_factor,
    padded,
    scaled_penalties,
    scratch_size,
    semiglobal_winners,
)
from svdm_core.kernels.arrays import aligned_zeros
from svdm_core.matching_cost.planes import BLOCK, INTENSITY, MatchingPlanes

STEPS = ((0, 1), (0, -1), (1, 0), (-1, 0))  # from the left, the right, above and below


def penalties_of(left, right, parameters):
    penalties = np.full(penalties_shape(*left.shape[:2]), 7, np.uint16)  # what has no meaning must not matter
    fill_penalties(left, right, *scaled_penalties(parameters), parameters.p2_edge, penalties)
    return penalties


def smooth(stages, parameters, volume, paths, pair=None):
    """`semiglobal_winners` over a volume (2, H, W, D), or over boxes without one; `pair` for its edges."""
    height, width = stages.shape
    stride = padded(parameters.num_disparities)
    empty = np.zeros((2, 0), np.uint16)
    stored = empty
    if volume is not None:
        stored = np.full((2, height, width, stride), volume.max(), np.uint16)
        stored[..., :volume.shape[3]] = volume
        stored = stored.reshape(2, -1)
    below = np.full((2, height * width * stride), 7, np.uint16) if paths == 4 else empty
    scratch = aligned_zeros((2, scratch_size(width, parameters.num_disparities)), np.uint16)
    scratch[:] = 999  # what was there before must not matter
    penalties = penalties_of(*(pair or [np.zeros(stages.shape, np.uint8)] * 2), parameters)
    return semiglobal_winners(stages.nodes, stages.planes, parameters, stages.shape, stored, below, scratch, penalties)


@pytest.mark.parametrize('paths', [3, 4])
@pytest.mark.parametrize(('shape', 'disparities', 'p2_edge'), [
    ((1, 1), 1, 9.0), ((1, 9), 5, 9.0), ((8, 1), 3, 9.0), ((5, 7), 32, 0.0), ((6, 5), 33, 40.0), ((9, 8), 40, 9.0),
    ((4, 6), 70, 1000.0), ((5, 7, 3), 20, 25.0),
])
def test_winners_and_vertices_are_those_of_the_summed_paths(shape, disparities, p2_edge, paths):
    parameters = MatcherParameters(num_disparities=disparities, p1=0.02, p2=0.12, p2_edge=p2_edge, paths=paths)
    pair = noise(*shape), noise(*shape, seed=1)
    shape = shape[:2]
    stages = Stages(*pair, parameters)
    volume = np.random.default_rng(disparities).integers(0, 300, (2, *shape, disparities)) * 20
    winner, vertex = smooth(stages, parameters, volume, paths, pair)

    unit = cost_factor(parameters) * INTENSITY
    p1, p2 = round(0.02 * unit), round(0.12 * unit)
    for view, image in enumerate((pair[0], pair[1][:, ::-1])):
        jump = oracles.jump_penalty(image, p1, p2, p2_edge) if p2_edge else lambda _before, _here: p2
        total = sum(oracles.path_costs(volume[view], step, p1, jump) for step in STEPS[:paths])
        np.testing.assert_array_equal(winner[view], total.argmin(axis=2))
        if view == 0:
            for (y, x), d in np.ndenumerate(winner[0]):
                inside = 0 < d < disparities - 1
                expected = oracles.symmetric_v(*total[y, x, d - 1:d + 2]) if inside else 0.0
                assert vertex[y, x] == pytest.approx(expected, abs=1e-6)


CENSUS_ONLY = {'tau_ad': 0.0, 'alpha': 0.0}


@pytest.mark.parametrize('costs', [
    {'census_weight': 0.2, 'tau_ad': 0.1}, {'census_weight': 0.3, **CENSUS_ONLY},
    {'census_weight': 0.01, 'p2': 0.5, **CENSUS_ONLY},  # a bit is less than one unit of the path costs
])
@pytest.mark.parametrize('disparities', [1, 20, 40])
@pytest.mark.parametrize('shape', [(1, 1), (1, 12), (3, 2), (9, 30)])
def test_sums_of_boxes_match_the_oracle_and_both_ways_to_them_agree(shape, disparities, costs):
    parameters = MatcherParameters(num_disparities=disparities, aggregation='box', min_disparity=1,
                                   **{'p1': 0.02, 'p2': 0.1, **costs})
    left, right = noise(*shape) // 8, noise(*shape, seed=1) // 8
    cost = Stages(left, right, parameters, isolated=True).volume().astype(float)
    factor = cost_factor(parameters) * INTENSITY
    stages = Stages(left, right, parameters)
    stages.planes = MatchingPlanes.empty(left.shape, 1 + padded(disparities), True)
    stages.planes.fill(left, right, 'horizontal')
    stages.nodes = ForestNodes.empty(stages.planes, stages.nodes_count)
    stages.nodes.gather_pixels(stages.planes, shape[1])

    directly = smooth(stages, parameters, None, 3)
    volume = np.stack([oracles.box_sum(np.floor(view * factor + 0.5)) for view in cost])
    from_volume = smooth(stages, parameters.replace(aggregation='tree'), volume.astype(np.uint16), 3)
    # a cost that float32 rounds the other way may turn a tie; nothing else may differ
    assert (directly[0] != from_volume[0]).mean() < 0.02

    stored = np.zeros((2, stages.nodes_count * padded(disparities)), np.uint16)
    scratch = aligned_zeros((2, scratch_size(shape[1], disparities)), np.uint16)
    flat = penalties_of(left * 0, right * 0, parameters)
    filled = semiglobal_winners(stages.nodes, stages.planes, parameters, shape, stored, stored[:, :0], scratch, flat)
    np.testing.assert_array_equal(filled[0], directly[0])
    np.testing.assert_array_equal(filled[1], directly[1])
    sums = stored.reshape(2, *shape, -1)[..., :disparities].astype(int)
    np.testing.assert_allclose(sums, volume, atol=1)
    assert sums.max() + scaled_penalties(parameters)[1] <= LARGEST  # four such sums fit into 16 bits


def test_the_volume_after_the_tree_is_divided_by_the_support_and_scaled():
    parameters = MatcherParameters(num_disparities=20, p2=0.3, tau_ad=0.5, census_weight=0.0)
    left, right = noise(5, 25), noise(5, 25, seed=1)
    stages = Stages(left, right, parameters, slots=2)
    ones = np.stack([oracles.support(stages.trees.parent[view], stages.trees.weight[view], parameters.sigma_tree,
                                     parameters.d_y).sum(axis=1) for view in range(2)])
    by_pixel = np.empty_like(ones)
    for view in range(2):
        by_pixel[view, stages.trees.pixel[view]] = ones[view]
    expected = stages.volume() * INTENSITY * cost_factor(parameters) / by_pixel.reshape(2, 5, 25, 1)

    stride = padded(20)
    volume = np.zeros((2, 125 * stride), np.uint16)
    scratch = np.zeros((2, stages.slots, 125 * BLOCK), np.float32)
    stages.planes = MatchingPlanes.empty(left.shape, stride, False)
    stages.planes.fill(left, right, 'horizontal')
    stages.nodes = ForestNodes.empty(stages.planes, 125)
    stages.nodes.gather(stages.trees, stages.planes, 25, parameters)
    aggregate_volume(stages.trees, stages.nodes, stages.planes, parameters, scratch, cost_factor(parameters), stride,
                     volume)
    volume = volume.reshape(2, 5, 25, stride)
    np.testing.assert_allclose(volume[..., :20], expected, atol=0.6)
    assert (volume[..., 20:] == volume[..., 20:].max()).all() and volume[..., 20:].min() >= volume[..., :20].max()


@pytest.mark.parametrize('aggregation', ['tree', 'box'])
def test_without_p2_smoothing_changes_nothing(aggregation):
    """P2 = 0 makes every path cost the matching cost: with boxes the winner is that of the 3x3 sums."""
    left, right = noise(8, 40), noise(8, 40, seed=1)
    parameters = MatcherParameters(num_disparities=12, aggregation=aggregation, p1=5.0, p2=0.0, subpixel=False)
    results = [StereoMatcher(parameters.replace(paths=paths)).compute(left, right) for paths in (3, 4)]
    np.testing.assert_array_equal(results[0].disparity, results[1].disparity)


def test_smoothing_takes_specks_away_and_keeps_a_wall():
    rng = np.random.default_rng(3)
    wall = np.tile(np.arange(120) * 3 % 97, (40, 1)).astype(np.uint8) + rng.integers(0, 20, (40, 120)).astype(np.uint8)
    left, right = wall[:, :100], wall[:, 6:106]
    right = np.clip(right + rng.integers(-15, 16, right.shape), 0, 255).astype(np.uint8)
    off = []
    for p2 in (0.0, 0.3):
        parameters = MatcherParameters(num_disparities=20, aggregation='box', census_weight=0.3, tau_ad=0.0, alpha=0.0,
                                       p1=0.05, p2=p2, w_p=1, final_median=1)
        disparity = StereoMatcher(parameters).compute(left, right).disparity[:, 8:]
        off.append((np.abs(disparity - 6) > 1).mean())
    assert off[1] < 0.2 * off[0] and off[0] > 0.02
