import cv2
import numpy as np
import oracles
import pytest
from scenes import noise
from stages import ByteStage, run, task_phase

from svdm_core import MatcherParameters, StereoMatcher
from svdm_core.cost_aggregation.box import PIXEL_COST
from svdm_core.disparity_optimization.paths import masks_of
from svdm_core.disparity_optimization.penalties import Penalties
from svdm_core.disparity_optimization.semiglobal import StripeWinners, Views, scratch_size, smooth_stripes
from svdm_core.kernels.stripes import OVERLAP, STRIPE, rows_of, stripe_count

P1 = 5, 9  # of the left view, of the right one


class Smoothing:
    """`smooth_stripes` of a pair with random penalties, and what the oracle makes of the same costs."""

    def __init__(self, shape, count, every, stored, colour=False):
        rng = np.random.default_rng(shape[0])
        self.rows, self.count = (rows_of(shape, 1), rows_of(shape, every)), count
        image = (*shape, 3) if colour else shape
        parameters = MatcherParameters(num_disparities=count, min_disparity=-1, tau_ad=0.0, alpha=0.0)
        self.stage = ByteStage(noise(*image) // 64, noise(*image, seed=1) // 64, parameters, PIXEL_COST)
        self.volumes = [self._boxes(view) if view not in stored else
                        rng.integers(0, 65, (rows.height, rows.width, self.stage.width))
                        for view, rows in enumerate(self.rows)]
        self.stored = [volume.astype(np.uint8).reshape(-1) if view in stored else np.zeros(0, np.uint8)
                       for view, volume in enumerate(self.volumes)]
        self.across, self.down = rng.integers(9, 90, (2, 2, (shape[0] + 2) * shape[1])).astype(np.uint8)

    def _boxes(self, view):
        before, rows = self.stage.planes.before, self.rows[view]
        census = self.stage.planes.census[:, rows.offset::rows.every, :, before:before + rows.width]
        none = np.zeros((1, rows.height, rows.width))
        return oracles.box_bytes(oracles.byte_cost(none, none, census[view], census[1 - view][..., ::-1],
                                                   self.stage.costs, self.stage.width, PIXEL_COST))

    def found(self, paths, threads=1):
        left, right = self.rows
        lanes = self.stage.lanes
        winners = StripeWinners(np.zeros((left.height, left.width), np.int16),
                                np.zeros((right.height, left.width), np.int16),
                                np.full((left.height, left.width), 9, np.float32),
                                np.full((left.height, left.width), 9, np.uint8),
                                masks_of(self.count, self.stage.width), self.count)
        table = np.zeros(256, np.uint8)
        penalties = Penalties(*map(np.uint8, P1), table, table, self.across, self.down)
        views = Views(left.height, right.height, left.width, right.every, paths, *self.stored)
        run(task_phase(stripe_count(left) + stripe_count(right), smooth_stripes, self.stage.costs, penalties, views,
                       winners, lanes, scratch=scratch_size(left.width, self.stage.width, paths)), threads=threads)
        return winners

    def sums(self, view, paths):
        rows = self.rows[view]
        across, down = (part[view, :rows.height * rows.width].reshape(rows.height, -1).astype(int)
                        for part in (self.across, self.down))
        return oracles.stripe_sums(self.volumes[view], P1[view], across, down, paths, STRIPE // rows.every,
                                   OVERLAP // rows.every)


@pytest.mark.parametrize('paths', [3, 4])
@pytest.mark.parametrize('stored', [(), (0, 1), (0,)])
@pytest.mark.parametrize(('shape', 'count', 'every'), [
    ((1, 1), 1, 2), ((1, 9), 33, 2), ((6, 1), 5, 1), ((11, 7), 32, 1), ((5, 6), 33, 2), ((131, 2), 9, 4),
    ((62, 3), 32, 2),
])
def test_winners_and_vertices_are_those_of_the_summed_paths(shape, count, every, stored, paths):
    smoothing = Smoothing(shape, count, every, stored)
    winners = smoothing.found(paths, threads=2)
    for view, winner in enumerate((winners.left, winners.right)):
        total = smoothing.sums(view, paths)
        np.testing.assert_array_equal(winner, total[..., :count].argmin(axis=2))
        if view == 0:
            for (y, x), d in np.ndenumerate(winner):
                inside = 0 < d < count - 1
                expected = oracles.symmetric_v(*total[y, x, d - 1:d + 2]) if inside else 0.0
                assert winners.vertex[y, x] == pytest.approx(expected, abs=1e-6)
                assert winners.margin[y, x] == oracles.margin(total[y, x, :count])


def test_a_colour_image_has_the_boxes_of_its_grey_one():
    smoothing = Smoothing((9, 8), 32, 1, (), colour=True)
    np.testing.assert_array_equal(smoothing.found(3).right, smoothing.sums(1, 3).argmin(axis=2))


@pytest.mark.parametrize('aggregation', ['tree', 'box'])
def test_a_wall_is_kept_and_specks_are_taken_away(aggregation):
    rng = np.random.default_rng(3)
    wall = np.tile(np.arange(120) * 3 % 97, (40, 1)).astype(np.uint8) + rng.integers(0, 20, (40, 120)).astype(np.uint8)
    left, right = wall[:, :100], wall[:, 6:106]
    right = np.clip(right + rng.integers(-15, 16, right.shape), 0, 255).astype(np.uint8)
    off = []
    for p2 in (0.001, 0.3):
        parameters = MatcherParameters(num_disparities=20, aggregation=aggregation, census_weight=0.3, tau_ad=0.0,
                                       alpha=0.0, p1=0.05, p2=p2, w_p=1, final_median=1)
        disparity = StereoMatcher(parameters).compute(left, right).disparity[:, 8:]
        off.append((np.abs(disparity - 6) > 1).mean())
    assert off[1] < 0.2 * off[0] and off[0] > 0.02


def test_without_p2_boxes_win_by_their_sums_however_many_paths_there_are():
    """P2 = 0 makes every path cost the matching cost."""
    left, right = (cv2.GaussianBlur(noise(8, 40, seed=seed), (3, 3), 0) for seed in (0, 1))
    parameters = MatcherParameters(num_disparities=12, aggregation='box', p1=5.0, p2=0.0, subpixel=False, tau_ad=0.0,
                                   alpha=0.0, w_p=1, final_median=1, tau_lr=1024.0, plane_fit=False)
    stage = ByteStage(left, right, parameters, PIXEL_COST)
    before = stage.planes.before
    none = np.zeros((1, 8, 40))
    census = stage.planes.census[..., before:before + 40]
    boxes = oracles.box_bytes(oracles.byte_cost(none, none, census[0], census[1][..., ::-1], stage.costs, 32, 34))
    for paths, most in ((3, 85), (4, 127)):  # what three and half of four can be without a cut
        result = StereoMatcher(parameters.replace(paths=paths)).compute(left, right)
        certain = result.valid & (boxes[..., :12].min(axis=2) < most)
        assert certain.mean() > 0.5
        np.testing.assert_array_equal(result.disparity[certain], boxes[..., :12].argmin(axis=2)[certain])
