import ast
import os
import subprocess
import sys
import threading
from pathlib import Path

import cv2
import numpy as np
import oracles
import pytest
import row_scenes
from checkout import CHECKOUT
from scenes import noise, shifted_wall, two_walls

import svdm_core
from svdm_core import MatcherParameters, RowAlignment, StereoMatcher, load_preset, preset_names
from svdm_core.cost_aggregation.spanning_forest import SpanningTrees

ROWS = RowAlignment((0.9, 0, 0, 0.9, 0, 0), row_scenes.WIDTH, row_scenes.HEIGHT)
SMALL = MatcherParameters(num_disparities=20, w_p=7)
BOX = {'aggregation': 'box', 'paths': 3}

# The paper's stages.
LITERAL = {'intensity_range': 'full', 'tau_ad': 7 / 255, 'census_weight': 0.0, 'p2': 0.0, 'sigma_tree': 0.1,
           'final_median': 1, 'uniqueness': 0.0, 'filling': 'scanline', 'plane_fit': False}


def match(left, right, parameters=SMALL, threads=0):
    return StereoMatcher(parameters, threads).compute(left, right)


def assert_same(result, other):
    np.testing.assert_array_equal(result.disparity, other.disparity)
    np.testing.assert_array_equal(result.valid, other.valid)


# Against the oracles

@pytest.mark.parametrize('depth', [1, 3])
@pytest.mark.parametrize('min_disparity', [-4, 0, 2])
@pytest.mark.parametrize('changes', [
    {}, {'gradient': 'magnitude', 'd_y': 60}, {'sigma_tree': 0.5, 'tau_ad': 0.2, 'tau_gm': 0.1},
    {'census_weight': 0.3},
])
def test_all_stages_together_are_those_of_the_oracles(depth, min_disparity, changes):
    shape = (9, 14) if depth == 1 else (9, 14, 3)
    # so little contrast that costs are rarely all truncated, which would make ties that rounding decides
    left, right = noise(*shape) // 16, noise(*shape, seed=1) // 16
    parameters = MatcherParameters(min_disparity=min_disparity, num_disparities=6, subpixel=False, median_scope='all',
                                   w_p=1, tau_lr=0.0, **{**LITERAL, **changes})
    result = match(left, right, parameters)

    costs = [aggregated_cost(*pair, parameters) for pair in ((left, right), (right[:, ::-1], left[:, ::-1]))]
    winners = [cost.argmin(axis=2) for cost in costs]
    valid = oracles.left_right_check(winners[0], winners[1][:, ::-1], min_disparity, 0.0)
    np.testing.assert_array_equal(result.valid, valid)
    np.testing.assert_array_equal(result.disparity, oracles.fill(winners[0], valid) + min_disparity)


def aggregated_cost(left, right, parameters):
    guide = np.ascontiguousarray(left)
    grey = [np.ascontiguousarray(image) for image in (left, right)]
    grey = [image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY) for image in grey]
    # the kernel mirrors the right view's pair; a signed gradient then changes its sign on both sides alike
    slopes = [oracles.gradient(image, parameters.gradient) for image in grey]
    bits = [oracles.census(image) for image in grey]
    cost = oracles.matching_cost(left, right, *slopes, *bits, parameters).reshape(-1, parameters.num_disparities)
    trees = SpanningTrees.empty(guide.shape)
    trees.build(guide, guide)
    pixel, parent, weight = trees.pixel[0], trees.parent[0], trees.weight[0]
    total = np.empty_like(cost)
    total[pixel] = oracles.support(parent, weight, parameters.sigma_tree, parameters.d_y) @ cost[pixel]
    return total.reshape(*left.shape[:2], -1)


# Scenes with a known answer

@pytest.mark.parametrize('stages', [LITERAL, {}, BOX])
@pytest.mark.parametrize(('shift', 'min_disparity'), [(0, 0), (12, 0), (9, 4), (-9, -15), (-17, -18), (-9, -1024)])
def test_a_flat_wall_is_found_exactly(shift, min_disparity, stages):
    left, right = shifted_wall(40, 70, abs(shift))
    if shift < 0:
        left, right = right, left
    count = 1024 if min_disparity == -1024 else 20
    result = match(left, right, SMALL.replace(min_disparity=min_disparity, num_disparities=count, **stages))
    inside = np.s_[4:-4, max(shift, 0) + 5:min(shift, 0) - 5]  # beside the border the neighbourhoods differ
    assert np.abs(result.disparity[inside] - shift).max() <= 0.5 and result.valid[inside].all()


def test_a_square_before_a_wall_has_sharp_borders():
    left, right, truth = two_walls()
    result = match(left, right)
    assert (np.abs(result.disparity - truth) > 1).mean() < 0.02
    occluded = ~result.valid[:, 30:60]
    assert 0 < occluded.mean() < 0.3


@pytest.mark.parametrize('stages', [LITERAL, {}])
def test_subpixel_is_nearer_to_a_fractional_shift(stages):
    texture = cv2.normalize(cv2.GaussianBlur(noise(60, 160), (0, 0), 2.0), None, 0, 255, cv2.NORM_MINMAX)
    moved = cv2.warpAffine(texture, np.float32([[1, 0, -6.3], [0, 1, 0]]), (160, 60), flags=cv2.INTER_CUBIC)
    left, right = texture[:, 20:140], moved[:, 20:140]
    errors = [np.abs(match(left, right, SMALL.replace(subpixel=on, **stages)).disparity[5:-5, 12:-12] - 6.3).mean()
              for on in (False, True)]
    assert errors[0] == pytest.approx(0.3, abs=0.05) and errors[1] < 0.75 * errors[0]


@pytest.mark.parametrize('stages', [{}, LITERAL, {'aggregation': 'box'}])
@pytest.mark.parametrize('scope', ['filled', 'all'])
def test_a_constant_scene_gets_the_smallest_disparity(scope, stages):
    grey = np.full((12, 70), 77, np.uint8)
    result = match(grey, grey, SMALL.replace(min_disparity=3, num_disparities=50, median_scope=scope, **stages))
    assert (result.disparity == 3).all()


def test_four_paths_see_no_difference_between_top_and_bottom_and_three_do():
    left, right = noise(30, 60), noise(30, 60, seed=1)
    same = []
    for paths in (3, 4):
        parameters = MatcherParameters(num_disparities=12, aggregation='box', paths=paths, w_p=1, tau_lr=100.0,
                                       subpixel=False, final_median=1, filling='scanline', plane_fit=False)
        upright, upside_down = match(left, right, parameters), match(left[::-1], right[::-1], parameters)
        same.append((upright.disparity == upside_down.disparity[::-1]).mean())
    assert same[0] < 0.9 and same[1] > 0.99  # but for ties


def test_the_mirrored_and_swapped_pair_gives_the_right_views_map():
    left, right, truth = two_walls()
    result = match(right[:, ::-1], left[:, ::-1])
    right_map = np.rint(result.disparity[:, ::-1])
    y, x = np.nonzero(match(left, right).valid)
    d = truth[y, x]
    assert (np.abs(right_map[y, x - d] - d) <= 1).mean() > 0.97


# Exactness

def test_a_buffer_kept_from_another_frame_leaves_nothing_behind():
    pairs = [(noise(*shape, dtype=dtype), noise(*shape, dtype=dtype, seed=1))
             for shape in ((45, 80, 3), (20, 30), (70, 31), (45, 80)) for dtype in (np.uint8, np.uint16)]
    changes = [{}, BOX, LITERAL, {'min_disparity': -9, 'right_rows': 1}, {'num_disparities': 31, **BOX},
               {'guide_blur': 3, 'tau_ad': 0.0, 'alpha': 0.0}, {'census_weight': 0.0, 'subpixel': False},
               {'aggregation': 'box', 'w_p': 11, 'right_rows': 4}, {'median_scope': 'all'}]
    kept = StereoMatcher(SMALL, 2)
    rng = np.random.default_rng(5)
    for k in rng.permutation(len(pairs) * len(changes)):
        left, right = pairs[k % len(pairs)]
        kept.parameters = SMALL.replace(**changes[k // len(pairs)])
        assert_same(kept.compute(left, right), match(left, right, kept.parameters, threads=1))


DIGESTS = '''
import hashlib, sys
sys.path.insert(0, "test/support")
from scenes import noise
from svdm_core import StereoMatcher, load_preset, preset_names
for name in preset_names():
    for shape in ((125, 33), (125, 33, 3)):
        parameters = load_preset(name).replace(num_disparities=64)
        for threads in THREADS:
            matcher = StereoMatcher(parameters, threads)
            for _ in range(2):
                result = matcher.compute(noise(*shape) // 4, noise(*shape, seed=1) // 4)
                digest = hashlib.sha256(result.disparity.tobytes() + result.valid.tobytes())
                print(name, len(shape), digest.hexdigest())'''


@pytest.mark.slow
@pytest.mark.timeout(300)  # kernels are compiled on the way
def test_any_number_of_threads_gives_the_same_bytes_each_time():
    """In processes of their own: the number of threads is fixed when numba loads."""
    lines = []
    for most, threads in ((1, (1,)), (16, (1, 2, 3, 7, 16))):
        run = subprocess.run([sys.executable, '-c', DIGESTS.replace('THREADS', repr(threads))], cwd=CHECKOUT,
                             check=True, capture_output=True, text=True,
                             env={**os.environ, 'NUMBA_NUM_THREADS': str(most)})
        lines.append(run.stdout.splitlines())
    assert len(preset_names()) == 5 and len(lines[1]) == 5 * len(lines[0]) == 5 * 2 * 10
    assert sorted(set(lines[0])) == sorted(set(lines[1])) and len(set(lines[0])) == 10


def test_two_threads_may_match_at_once():
    pairs = [(noise(60, 90, seed=s), noise(60, 90, seed=s + 10)) for s in range(2)]
    expected = [match(*pair) for pair in pairs]
    results = [[], []]

    def work(k):
        matcher = StereoMatcher(SMALL)
        results[k] = [matcher.compute(*pairs[k]) for _ in range(5)]

    threads = [threading.Thread(target=work, args=(k,)) for k in range(2)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    for k in range(2):
        assert len(results[k]) == 5
        for result in results[k]:
            assert_same(result, expected[k])


def test_parameters_count_from_the_next_frame_on_and_results_are_the_callers_own():
    left, right = noise(30, 50), noise(30, 50, seed=1)
    matcher = StereoMatcher(SMALL)
    before = matcher.compute(left, right)
    copy = before.disparity.copy(), before.valid.copy()
    matcher.parameters = SMALL.replace(alpha=0.0, sigma_tree=1.0, num_disparities=9)
    after = matcher.compute(left, right)
    assert_same(after, match(left, right, matcher.parameters))
    assert (after.disparity != before.disparity).any()
    np.testing.assert_array_equal(before.disparity, copy[0])
    np.testing.assert_array_equal(before.valid, copy[1])


# Images of every kind

def assert_dense(result, shape, parameters):
    assert result.disparity.shape == result.valid.shape == shape[:2]
    assert (result.disparity.dtype, result.valid.dtype) == (np.float32, np.bool_)
    lowest = parameters.min_disparity
    assert lowest <= result.disparity.min() <= result.disparity.max() <= lowest + parameters.num_disparities - 1


@pytest.mark.parametrize('preset', ['default', 'fast', 'paper'])
@pytest.mark.parametrize('shape', [(1, 1), (1, 50), (50, 1), (2, 2, 3), (61, 7), (125, 33)])
@pytest.mark.parametrize('min_disparity', [-1024, -20, 0, 5, 1024])
@pytest.mark.parametrize('num_disparities', [1, 2, 31, 32])
def test_any_size_and_range_gives_a_dense_map_within_the_range(shape, min_disparity, num_disparities, preset):
    parameters = load_preset(preset).replace(min_disparity=min_disparity, num_disparities=num_disparities)
    result = match(noise(*shape), noise(*shape, seed=1), parameters)
    assert_dense(result, shape, parameters)
    apart = np.arange(shape[1]) - min_disparity  # the rightmost partner, and the leftmost
    assert not result.valid[:, (apart < 0) | (apart - num_disparities + 1 >= shape[1])].any()


@pytest.mark.slow
@pytest.mark.timeout(600)  # kernels are compiled for each width
@pytest.mark.parametrize('num_disparities', [33, 96, 255, 257, 600, 1024])
def test_wide_ranges_give_the_same_as_narrow_ones_where_they_need_not_look_further(num_disparities):
    """A wall at disparity 12 of an image narrower than the range."""
    left, right = shifted_wall(61, 30, 12)
    for preset in ('default', 'fast', 'paper'):
        parameters = load_preset(preset).replace(num_disparities=num_disparities, min_disparity=-3)
        result = match(left, right, parameters)
        assert_dense(result, left.shape, parameters)
        inside = np.s_[4:-4, 18:-5]
        assert (np.abs(result.disparity[inside] - 12) <= 0.5).mean() > 0.98


@pytest.mark.parametrize(('range_', 'share'), [('full', 0.001), ('pair', 0.005)])
def test_16_bit_images_of_8_bit_scenes_give_the_same_map(range_, share):
    """But for rounding: of the range of the pair, the edges of 8-bit images are whole grey levels, those of 16 not."""
    left, right, _ = two_walls()
    parameters = SMALL.replace(subpixel=False, intensity_range=range_)
    deep = match(left.astype(np.uint16) * 257, right.astype(np.uint16) * 257, parameters)
    assert (deep.disparity != match(left, right, parameters).disparity).mean() < share


def test_three_equal_channels_match_like_one():
    left, right, _ = two_walls()
    colour = match(*(np.repeat(image[..., None], 3, axis=2) for image in (left, right)))
    assert (np.abs(colour.disparity - match(left, right).disparity) > 0.02).mean() < 0.02


def test_strides_and_read_only_memory_do_not_matter_and_images_stay_as_they_are():
    left, right = noise(30, 41, 3), noise(30, 41, 3, seed=1)
    copies = left.copy(), right.copy()
    expected = match(left, right)
    padded = np.zeros((30, 60, 3), np.uint8)
    padded[:, 7:48] = left
    backwards = np.ascontiguousarray(right[::-1, :, ::-1])[::-1, :, ::-1]
    for a, b in ((padded[:, 7:48], backwards), (np.frombuffer(left.tobytes(), np.uint8).reshape(left.shape), right)):
        assert_same(match(a, b), expected)
    np.testing.assert_array_equal(left, copies[0])
    np.testing.assert_array_equal(right, copies[1])


GOOD = np.zeros((4, 6), np.uint8)


@pytest.mark.parametrize(('left', 'right', 'words'), [
    (GOOD.astype(np.float32), GOOD, ('left image', 'float32', 'uint8 or uint16')),
    (np.full((4, 6), np.nan), GOOD, ('left image', 'float64', 'uint8 or uint16')),
    (GOOD, GOOD.astype(np.int8), ('right image', 'int8', 'uint8 or uint16')),
    (GOOD, [[1, 2]], ('right image', 'list', 'numpy array')),
    (None, GOOD, ('left image', 'NoneType', 'numpy array')),
    (np.zeros((4, 6, 4), np.uint8), GOOD, ('left image', '(4, 6, 4)', '(H, W) or (H, W, 3)')),
    (np.zeros(5, np.uint8), GOOD, ('left image', '(5,)', '(H, W) or (H, W, 3)')),
    (np.zeros((0, 6), np.uint8), GOOD, ('left image', '(0, 6)', 'not empty')),
    (GOOD, np.zeros((4, 7), np.uint8), ('(4, 6)', '(4, 7)', 'same shape')),
    (GOOD, np.zeros((4, 6, 3), np.uint8), ('(4, 6)', '(4, 6, 3)', 'same shape')),
    (GOOD, GOOD.astype(np.uint16), ('uint8', 'uint16', 'same shape and dtype')),
])
def test_a_wrong_image_is_named_with_what_is_allowed(left, right, words):
    with pytest.raises(ValueError) as refusal:
        match(left, right)
    assert all(word in str(refusal.value) for word in words) and '\n' not in str(refusal.value)


def test_a_negative_number_of_threads_is_refused():
    with pytest.raises(ValueError, match='threads = -1 is not allowed'):
        StereoMatcher(threads=-1)


def test_timings_tell_each_stage_and_their_sum():
    timings = dict(match(noise(30, 50), noise(30, 50)).timings)
    total = timings.pop('total')
    assert set(timings) == {'spanning_forest', 'matching_cost', 'cost_aggregation', 'disparity_optimization',
                            'disparity_refinement'}
    assert min(timings.values()) > 0 and total == pytest.approx(sum(timings.values()))


WARM_UP = '''
import sys
sys.path.insert(0, "test/support")
import numpy as np
from scenes import noise
from svdm_core import StereoMatcher, load_preset, preset_names

def signatures():
    kernels = {id(value): value for module in list(sys.modules.values()) if module.__name__.startswith("svdm_core")
               for value in vars(module).values() if hasattr(value, "signatures")}
    return {f"{kernel.__name__}{signature}" for kernel in kernels.values() for signature in kernel.signatures}

for name in preset_names():
    StereoMatcher(load_preset(name)).warm_up()
before = signatures()
matcher = StereoMatcher()
for shape in ((20, 30), (20, 30, 3)):
    for dtype in (np.uint8, np.uint16):
        for name in preset_names():
            matcher.parameters = load_preset(name).replace(min_disparity=-9, num_disparities=60, alpha=1.0)
            image = noise(*shape, dtype=dtype)
            assert not matcher.not_compiled(image), name
            matcher.compute(image, image)
print(len(before) > 10, signatures() - before)'''


@pytest.mark.timeout(300)
def test_after_warm_up_nothing_is_compiled_any_more():
    """In a process of its own: here, other tests have compiled what the warm-up may lack."""
    run = subprocess.run([sys.executable, '-c', WARM_UP], cwd=CHECKOUT, capture_output=True, text=True, timeout=290)
    assert run.stdout == 'True set()\n', run.stdout + run.stderr


# The library is free of ROS

ROS = {'rclpy', 'sensor_msgs', 'stereo_msgs', 'std_msgs', 'rcl_interfaces', 'builtin_interfaces', 'svdm_ros'}


def test_no_module_imports_ros():
    package = Path(svdm_core.__file__).parent
    for path in package.glob('**/*.py'):
        for node in ast.walk(ast.parse(path.read_text())):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ''] if isinstance(node, ast.ImportFrom) else []
            assert not ROS & {name.split('.')[0] for name in names}, path.name


def test_nothing_of_ros_is_loaded():
    code = 'import sys; from svdm_core import StereoMatcher; print(*sys.modules)'
    run = subprocess.run([sys.executable, '-c', code], cwd=CHECKOUT, check=True, capture_output=True, text=True)
    loaded = set(run.stdout.split())
    assert not ROS & loaded and 'numba' in loaded


# Rows


def test_rows_are_aligned_first_and_their_time_is_told():
    left, right = row_scenes.pair('slanted speckles', ROWS)
    matcher = StereoMatcher(load_preset('fast').replace(num_disparities=24), 1)
    plain, aligned = matcher.compute(left, right), matcher.compute(left, right, ROWS)
    by_hand = matcher.compute(left, ROWS.apply(right))
    np.testing.assert_array_equal(aligned.disparity, by_hand.disparity)
    np.testing.assert_array_equal(aligned.valid, by_hand.valid)
    assert 'row_alignment' not in plain.timings and aligned.timings['row_alignment'] > 0
    assert aligned.timings['total'] == pytest.approx(
        sum(time for stage, time in aligned.timings.items() if stage != 'total'))
    errors = [np.abs(one.disparity - row_scenes.truth('slanted speckles')).mean() for one in (plain, aligned)]
    assert errors[1] < 0.7 * errors[0]
    refined = matcher.refine(matcher.match(left, right, ROWS))
    np.testing.assert_array_equal(refined.disparity, aligned.disparity)
    assert refined.timings['row_alignment'] > 0


def test_an_alignment_of_another_size_is_refused_and_the_matcher_goes_on():
    left, right = row_scenes.pair('leaves', ROWS)
    matcher = StereoMatcher(load_preset('fast').replace(num_disparities=24), 1)
    with pytest.raises(ValueError, match=r'^images of 100 x 200 px cannot be aligned by a row alignment for 280 x 200'):
        matcher.compute(left[:, :100], right[:, :100], ROWS)
    assert matcher.compute(left[:, :100], right[:, :100]).disparity.shape == (200, 100)
