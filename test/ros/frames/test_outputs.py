"""All outputs of a matched pair agree with each other, and with the geometry, at any scale and in any part."""
import array
import dataclasses

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from node_bench import camera_info, image_message
from sensor_msgs.msg import CompressedImage, Image, PointCloud2
from std_msgs.msg import Header

from svdm_core import MatcherParameters
from svdm_ros.calibration.geometry import StereoGeometry
from svdm_ros.frames.filtering import speckles
from svdm_ros.frames.frame_processing import FrameProcessor
from svdm_ros.frames.matched_frame import MatchedFrame
from svdm_ros.frames.messages import rclpy_types
from svdm_ros.frames.outputs import OUTPUTS, output_names
from svdm_ros.frames.preparation import beyond_reach, with_search_range
from svdm_ros.frames.views import FrameError, StereoFrame
from svdm_ros.node.parameter_set import NodeParameters

GEOMETRY = StereoGeometry(500.0, 0.25, 3.5, '', 505.0, 30.25, 20.5)
WIDTH, HEIGHT, SHIFT = 96, 64, 12


def frame_of(disparity, valid=None, left=None, geometry=GEOMETRY, confidence=None, **own):
    parameters = NodeParameters(MatcherParameters(min_disparity=-4, num_disparities=40), **own)
    disparity = np.asarray(disparity, np.float32)
    valid = np.ones(disparity.shape, bool) if valid is None else np.asarray(valid)
    confidence = np.float32(valid) if confidence is None else np.asarray(confidence, np.float32)
    return MatchedFrame(
        Header(frame_id='left'), np.zeros(disparity.shape, np.uint8) if left is None else left, disparity, valid,
        confidence, 1 / 64, geometry, parameters)


def made(frame, topic):
    return next(output.make(frame, rclpy_types()) for output in OUTPUTS if output.topic == topic)


def pixels(message):
    kind = {'32FC1': np.float32, '16UC1': np.uint16, 'bgr8': np.uint8}[message.encoding]
    values = np.frombuffer(message.data, kind)
    assert message.step * message.height == len(message.data)
    return values.reshape(message.height, message.width, *([3] if message.encoding == 'bgr8' else []))


def points(message):
    """x, y, z and the fourth field, (H, W, 4) float32."""
    assert [(field.offset, field.datatype, field.count) for field in message.fields] == [
        (0, 7, 1), (4, 7, 1), (8, 7, 1), (12, 7, 1)]
    assert [field.name for field in message.fields[:3]] == ['x', 'y', 'z']
    assert (message.point_step, message.row_step, message.is_dense) == (16, 16 * message.width, False)
    return np.frombuffer(message.data, np.float32).reshape(message.height, message.width, 4)


def naive_masks(frame):
    """What the message has a disparity for, and what has a depth; without speckles."""
    known, trusted = np.zeros((2, *frame.disparity.shape), bool)
    parameters, distance = frame.parameters, frame.geometry.focal_length * frame.geometry.baseline
    for y, x in np.ndindex(*known.shape):
        d = float(frame.disparity[y, x]) - frame.geometry.principal_offset
        depth = np.inf if d <= 0 else distance / d
        near_enough = not parameters.max_depth or depth <= parameters.max_depth
        inside = near_enough and (depth >= parameters.min_depth or not distance)
        confident = frame.confidence[y, x] >= np.float32(parameters.confidence_threshold)
        trusted[y, x] = inside and confident and (parameters.publish_filled or frame.valid[y, x])
        known[y, x] = inside if parameters.publish_filled else trusted[y, x]
    return known, trusted


def naive_depth(frame):
    depth = np.full(frame.disparity.shape, np.nan)
    geometry = frame.geometry
    trusted = naive_masks(frame)[1]
    for y, x in np.ndindex(*depth.shape):
        d = float(frame.disparity[y, x]) - geometry.principal_offset
        if trusted[y, x] and d > 0 and geometry.focal_length * geometry.baseline > 0:
            depth[y, x] = geometry.focal_length * geometry.baseline / d
    return depth


FRAMES = st.builds(
    lambda seed, filled, **own: frame_of(
        np.random.default_rng(seed).uniform(-4, 35, (7, 9)), np.random.default_rng(seed + 1).random((7, 9)) > 0.3,
        confidence=np.random.default_rng(seed + 2).random((7, 9)), publish_filled=filled, **own),
    st.integers(0, 10**6), st.booleans(), max_depth=st.sampled_from([0.0, 8.0]),
    min_depth=st.sampled_from([0.0, 5.0]), confidence_threshold=st.sampled_from([0.0, 0.2, 0.5]),
    point_stride=st.integers(1, 4))


@settings(deadline=None, derandomize=True)
@given(FRAMES)
def test_disparity_depth_and_points_agree(frame):
    depth, stride = naive_depth(frame), frame.parameters.point_stride
    np.testing.assert_allclose(pixels(made(frame, 'depth/image_rect')), depth, rtol=1e-6)
    message = made(frame, 'disparity')
    disparity = pixels(message.image)
    known = disparity >= message.min_disparity
    np.testing.assert_array_equal(known, naive_masks(frame)[0])
    ahead = np.isfinite(depth)
    assert known[ahead].all()
    np.testing.assert_allclose(message.f * message.t / disparity[ahead], depth[ahead], rtol=1e-5)
    cloud = points(made(frame, 'points2'))
    geometry = frame.geometry
    for (y, x), z in np.ndenumerate(depth[::stride, ::stride]):
        wanted = [(x * stride - geometry.cx) * z / geometry.focal_length,
                  (y * stride - geometry.cy) * z / geometry.focal_length_y, z]
        np.testing.assert_allclose(cloud[y, x, :3], wanted, rtol=1e-5, atol=1e-6)
    finite = depth[np.isfinite(depth)]
    if frame.parameters.max_depth:
        assert (finite <= 8.0 + 1e-4).all()
    if frame.parameters.min_depth:
        assert (finite >= 5.0 - 1e-4).all()


def test_depth_in_mm_is_0_where_it_is_unknown_or_does_not_fit():
    frame = frame_of([[28.5, 3.6, 3.5, 0, 10], [8.5, 4.0, 5.0, 35, 35]], np.ones((2, 5), bool), depth_encoding='16UC1')
    metres = naive_depth(frame)
    message = made(frame, 'depth/image_rect')
    assert message.encoding == '16UC1'
    fits = np.nan_to_num(1000 * metres, nan=1e9) <= 65535
    assert 3 < fits.sum() < 9
    np.testing.assert_array_equal(pixels(message), np.where(fits, np.rint(1000 * np.nan_to_num(metres)), 0))


def test_without_geometry_there_is_no_depth():
    frame = frame_of([[5, 6]], geometry=StereoGeometry(problem='no camera_info'))
    assert np.isnan(pixels(made(frame, 'depth/image_rect'))).all()
    assert np.isnan(points(made(frame, 'points2'))[..., :3]).all()
    info = made(frame, 'depth/camera_info')
    assert info.k[0] == 0  # not calibrated, as CameraInfo has it


def test_camera_info_projects_points_onto_their_pixels():
    frame = frame_of(np.full((40, 60), 20.0))
    cloud, info = points(made(frame, 'points2')), made(frame, 'depth/camera_info')
    assert (info.width, info.height) == (60, 40)
    at = np.einsum('ij,yxj->yxi', np.reshape(info.p, (3, 4)), np.dstack([cloud[..., :3], np.ones((40, 60))]))
    columns, rows = np.meshgrid(np.arange(60), np.arange(40))
    np.testing.assert_allclose(at[..., 0] / at[..., 2], columns, atol=1e-3)
    np.testing.assert_allclose(at[..., 1] / at[..., 2], rows, atol=1e-3)
    assert list(info.d) == [0] * 5 and list(info.r) == [1, 0, 0, 0, 1, 0, 0, 0, 1]
    np.testing.assert_array_equal(np.reshape(info.k, (3, 3)), np.reshape(info.p, (3, 4))[:, :3])


@pytest.mark.parametrize(('dtype', 'shift'), [(np.uint8, 0), (np.uint16, 8)])
def test_points_have_the_colours_or_the_grey_levels_of_the_left_image(dtype, shift):
    random = np.random.default_rng(3)
    colour = random.integers(0, np.iinfo(dtype).max, (5, 6, 3), dtype, endpoint=True)
    cloud = points(made(frame_of(np.full((5, 6), 9.0), left=colour), 'points2'))
    packed = np.ascontiguousarray(cloud[..., 3]).view(np.uint32)  # as PCL has it: 0x00RRGGBB
    parts = np.dstack([packed & 255, packed >> 8 & 255, packed >> 16 & 255])
    np.testing.assert_array_equal(parts, colour >> shift)
    grey = made(frame_of(np.full((5, 6), 9.0), left=colour[..., 0]), 'points2')
    assert grey.fields[3].name == 'intensity'
    np.testing.assert_array_equal(points(grey)[..., 3], colour[..., 0])


def test_the_preview_goes_from_blue_to_red_over_the_search_range_and_is_black_where_nothing_is_known():
    values = np.repeat([[-4.0, 15.4, 35.0, 15.4]], 16, axis=0).repeat(16, axis=1)
    valid = np.repeat([[True, True, True, False]], 16, axis=0).repeat(16, axis=1)
    frame = frame_of(values, valid, publish_filled=False)
    picture = pixels(made(frame, 'disparity/preview'))
    colours = cv2.applyColorMap(np.array([[0, 127, 255]], np.uint8), cv2.COLORMAP_TURBO)[0]
    for number, colour in enumerate([*colours, (0, 0, 0)]):
        assert (picture[:, 16 * number:16 * number + 16] == colour).all()
    message = made(frame, 'disparity/preview/compressed')
    assert 'jpeg' in message.format
    decoded = cv2.imdecode(np.frombuffer(message.data, np.uint8), cv2.IMREAD_COLOR)
    assert np.abs(decoded.astype(int) - picture).mean() < 6


def test_confidence_is_that_of_the_matcher_whatever_the_filters_leave():
    frame = frame_of([[5, 6], [7, 8]], np.zeros((2, 2), bool), confidence=[[0, 0.25], [0.5, 1]], publish_filled=False,
                     confidence_threshold=0.75, max_depth=1.0)
    assert pixels(made(frame, 'confidence')).tolist() == [[0, 0.25], [0.5, 1]]


@pytest.mark.parametrize(('own', 'disparities', 'depths'), [
    ({}, [1, 1, 1, 1], [0, 1, 0, 1]),
    ({'confidence_threshold': 0.0}, [1, 1, 1, 1], [1, 1, 1, 1]),
    ({'confidence_threshold': 0.5}, [1, 1, 1, 1], [0, 0, 0, 1]),
    ({'publish_filled': False}, [0, 1, 0, 0], [0, 1, 0, 0]),
    ({'publish_filled': False, 'confidence_threshold': 0.0}, [1, 1, 0, 0], [1, 1, 0, 0]),
    ({'publish_filled': False, 'confidence_threshold': 0.5}, [0, 0, 0, 0], [0, 0, 0, 0])])
@pytest.mark.parametrize('encoding', ['32FC1', '16UC1'])
def test_the_threshold_is_for_depth_points_and_preview_and_publish_filled_for_the_disparity(
        own, disparities, depths, encoding):
    """Pixels: measured and not, of confidence 0.19 and 0.2 (as float32) and more."""
    frame = frame_of([[20, 20, 20, 20]], [[True, True, False, False]], confidence=[[0.19, 0.2, 0.19, 0.9]],
                     depth_encoding=encoding, **own)
    message = made(frame, 'disparity')
    assert (pixels(message.image) >= message.min_disparity).tolist() == [list(map(bool, disparities))]
    depth = pixels(made(frame, 'depth/image_rect'))[0]
    assert (depth > 0).tolist() == list(map(bool, depths))
    assert all(np.isnan(depth[~(depth > 0)])) if encoding == '32FC1' else not depth[~(depth > 0)].any()
    assert np.isfinite(points(made(frame, 'points2'))[0, :, 2]).tolist() == list(map(bool, depths))
    assert pixels(made(frame, 'disparity/preview'))[0].any(axis=-1).tolist() == list(map(bool, depths))


def test_speckles_are_searched_among_what_the_threshold_leaves():
    """Nine pixels alike, of which the threshold leaves two and four that do not touch."""
    frame = frame_of([[20] * 9], confidence=[[1, 1, 0, 0, 0, 1, 1, 1, 1]], speckle_size=3)
    assert np.isfinite(frame.depth).tolist() == [[False] * 5 + [True] * 4]
    assert (frame.published > 0).all()


def test_nothing_is_made_for_an_output_that_nobody_listens_to():
    """The masks with the search for speckles, which takes longest, above all."""
    made_for = {}
    for topic in ('disparity', 'depth/image_rect', 'points2', 'confidence', 'disparity/preview'):
        frame = frame_of([[5, 6]], max_depth=100.0, speckle_size=1)
        fields = set(vars(frame))
        made(frame, topic)
        made_for[topic] = set(vars(frame)) - fields
    of_depth = {'trusted', 'candidates', 'confident', 'shifted', 'depth'}
    assert made_for == {
        'disparity': {'known', 'candidates', 'shifted', 'published'}, 'depth/image_rect': of_depth, 'points2': of_depth,
        'confidence': set(), 'disparity/preview': of_depth - {'depth'} | {'picture'}}


@pytest.mark.parametrize('output', OUTPUTS, ids=lambda output: output.topic)
def test_each_output_has_its_type_and_the_header_of_the_left_image(output):
    message = output.make(frame_of([[5, 6]]), rclpy_types())
    package, _, name = output.message_type.split('/')
    assert type(message).__name__ == name and type(message).__module__.startswith(f'{package}.msg')
    assert message.header.frame_id == 'left'
    assert isinstance(message, (Image, PointCloud2, CompressedImage)) or name in ('DisparityImage', 'CameraInfo')


def test_the_topics_are_different_and_the_names_are_listed_once():
    assert len({output.topic for output in OUTPUTS}) == len(OUTPUTS)
    assert output_names(NodeParameters()) == ('disparity', 'depth', 'points', 'confidence', 'preview')
    assert output_names(NodeParameters(input='raw'))[-1] == 'rectified'


@settings(deadline=None, derandomize=True)
@given(st.integers(0, 10**6), st.integers(1, 30))
def test_speckles_are_small_regions_of_like_disparities(seed, size):
    random = np.random.default_rng(seed)
    disparity = np.float32(random.choice([0, 0.5, 9, 9.75, 20], (9, 11)))
    known = random.random((9, 11)) > 0.2
    expected = np.zeros(known.shape, bool)
    for y, x in zip(*np.nonzero(known), strict=True):
        region, waiting = {(y, x)}, [(y, x)]
        while waiting:
            at = waiting.pop()
            for step in ((0, 1), (1, 0), (0, -1), (-1, 0)):
                to = at[0] + step[0], at[1] + step[1]
                if 0 <= to[0] < 9 and 0 <= to[1] < 11 and to not in region and known[to] and abs(
                        disparity[to] - disparity[at]) <= 1:
                    region.add(to)
                    waiting.append(to)
        expected[y, x] = len(region) <= size
    np.testing.assert_array_equal(speckles(disparity, known, size), expected)


def wall(width=WIDTH, height=HEIGHT, shift=SHIFT):
    """A flat wall of blobs, so that it has texture at half and a quarter of the size too."""
    noise = np.random.default_rng(5).random((height // 4 + 1, (width + shift) // 4 + 1))
    dots = cv2.resize(noise, (width + shift, height), interpolation=cv2.INTER_CUBIC)
    grey = np.uint8(255 * np.clip(dots, 0, 1))
    return image_message(grey[:, :width]), image_message(np.ascontiguousarray(grey[:, shift:]))


def processed(**values):
    left, right = wall()
    infos = camera_info('left', WIDTH, HEIGHT), camera_info('right', WIDTH, HEIGHT)
    parameters = NodeParameters().replace({'num_disparities': 16, 'approximate_sync_tolerance': 0.0, **values})
    return FrameProcessor().process(StereoFrame(left, right, *infos, 0.0), parameters)


@pytest.mark.parametrize('values', [
    {}, {'downscale': 2}, {'downscale': 3}, {'roi': '16, 8, 72, 48'}, {'roi': '20 4 64 56', 'downscale': 2},
    {'min_disparity': -3, 'num_disparities': 32}, {'min_depth': 1.2}, {'min_depth': 1.2, 'downscale': 2}])
def test_a_wall_is_at_the_same_place_at_any_scale_and_in_any_part(values):
    frame = processed(**values).frame
    depth = frame.depth[8:-8, 16:-8]
    expected = 100.0 * 0.2 / (SHIFT - 2.5)
    # Half a disparity of the shrunk image is more than one of the whole.
    assert np.nanmedian(depth) == pytest.approx(expected, rel=0.03 * values.get('downscale', 1))
    cloud = points(made(frame, 'points2'))
    x0 = 16 if values.get('roi', '').startswith('16') else 20 if 'roi' in values else 0
    factor = values.get('downscale', 1)
    column = 10
    u = x0 + factor * (column + 0.5) - 0.5
    z = cloud[10, column, 2]
    assert cloud[10, column, 0] == pytest.approx((u - WIDTH / 2) * z / 100.0, abs=1e-4)
    info = made(frame, 'depth/camera_info')
    assert (info.width, info.height) == (frame.disparity.shape[1], frame.disparity.shape[0])


def test_the_search_range_follows_from_min_depth():
    frame = processed(min_depth=1.2).frame
    # f T / Z + offset = 100 * 0.2 / 1.2 + 2.5 = 19.2 px
    assert frame.parameters.matcher.num_disparities == 21
    done = processed(min_depth=0.001)
    assert done.frame.parameters.matcher.num_disparities == 1024
    assert 'min_depth = 0.001 m takes disparities 0 to 20003 px' in done.problem
    left, right = wall()
    blind = FrameProcessor().process(StereoFrame(left, right, None, None, 0.0), NodeParameters(
        MatcherParameters(num_disparities=16), min_depth=1.0))
    assert blind.frame.parameters.matcher.num_disparities == 16
    assert 'min_depth is not used' in blind.problem


@pytest.mark.parametrize(('values', 'told'), [
    ({'roi': '90, 0, 10, 10'}, "roi = '90, 0, 10, 10' is not within the image of 96x64 px"),
    ({'roi': '0, 0, 2, 2', 'downscale': 4}, 'downscale = 4 leaves nothing of 2x2 px')])
def test_what_leaves_no_image_is_told(values, told):
    with pytest.raises(FrameError, match='pair dropped') as caught:
        processed(**values)
    assert told in str(caught.value)


@pytest.mark.parametrize('roi', ['1,2,3', '1 2 3 x', '-1 2 3 4', '0 0 0 5', '1.5 2 3 4', '1,2,3,4,5', '٣ 1 1 1'])
def test_a_bad_roi_is_refused_by_name(roi):
    with pytest.raises(ValueError, match=r'roi = .* is not allowed: '):
        NodeParameters(roi=roi)


def test_max_depth_must_lie_behind_min_depth():
    with pytest.raises(ValueError, match='max_depth = 1 is not allowed: it must be more than min_depth = 2 m, or 0'):
        NodeParameters(min_depth=2.0, max_depth=1.0)


@pytest.mark.parametrize(('offset', 'start', 'told'), [
    (-20.0, 0, 'set min_disparity to -20'), (-20.5, -20, 'set min_disparity to -21'), (-20.0, -20, ''), (12.0, 0, ''),
    (0.0, 5, ''), (12.0, 13, 'set min_disparity to 12'), (0.4, 1, '')])
def test_a_search_that_cannot_reach_infinity_is_told(offset, start, told):
    line = beyond_reach(StereoGeometry(500.0, 0.2, offset), start)
    assert told in line and bool(line) is bool(told)


def test_how_far_a_search_reaches_is_a_hint_and_no_problem():
    done = processed(min_disparity=4)  # infinity lies at 2.5 px
    assert f'nothing beyond {100.0 * 0.2 / 1.5:.3g} m is found' in done.hint and 'set min_disparity to 2' in done.hint
    assert done.problem == '' and processed().hint == ''


@pytest.mark.parametrize('min_depth', [1e-320, 1e-300, 1e-9])
def test_a_tiny_min_depth_is_told_in_a_short_line(min_depth):
    parameters, problem = with_search_range(NodeParameters(min_depth=min_depth), StereoGeometry(500.0, 0.2, 1.0))
    assert parameters.matcher.num_disparities == 1024 and 'set downscale' in problem and len(problem) < 300


def test_a_threshold_alone_does_not_narrow_the_window_of_the_disparity():
    def window(**own):
        frame = frame_of(np.full((4, 60), 9.0), **own)
        frame = dataclasses.replace(frame, parameters=frame.parameters.replace({'min_disparity': 5}))
        found = made(frame, 'disparity').valid_window
        return found.x_offset, found.width

    assert window(confidence_threshold=0.5) == (0, 60)
    assert window(publish_filled=False) == (5, 55)


@pytest.mark.parametrize('roi', [[8, 4, 40, 30], (8, 4, 40, 30), array.array('q', [8, 4, 40, 30]), '8 4 40 30'])
def test_a_region_may_be_a_list_of_integers(roi):
    assert NodeParameters().replace({'roi': roi}).region == (8, 4, 40, 30)


@pytest.mark.parametrize('roi', [[1.5, 2, 3, 4], [1, 2], 7, None])
def test_another_list_is_refused(roi):
    with pytest.raises(ValueError, match=r'roi = .* is not allowed: it must be four integers such as'):
        NodeParameters().replace({'roi': roi})


def test_where_nothing_is_left_it_is_told():
    done = processed(max_depth=0.5)
    assert not done.frame.known.any() and not done.frame.trusted.any()
    assert 'no disparity is left in the whole image: look at max_depth, num_disparities' in done.problem


def grey_pair(**values):
    """Images without any texture."""
    left, right = (image_message(np.full((HEIGHT, WIDTH), 90, np.uint8)) for _ in range(2))
    infos = camera_info('left', WIDTH, HEIGHT), camera_info('right', WIDTH, HEIGHT)
    return FrameProcessor().process(
        StereoFrame(left, right, *infos, 0.0), NodeParameters().replace({'num_disparities': 16, **values}))


def test_images_without_texture_have_a_disparity_and_no_depth():
    frame = grey_pair().frame
    assert frame.known.all() and not frame.trusted.any()
    assert grey_pair(confidence_threshold=0.0).frame.trusted.all()


def test_a_threshold_that_leaves_no_depth_of_a_good_match_is_told():
    told = 'no pixel of the whole image reaches confidence_threshold = 1, so that none has a depth: lower it'
    assert told in processed(confidence_threshold=1.0).problem
    assert processed(confidence_threshold=0.5).problem == grey_pair(confidence_threshold=1.0).problem == ''


@pytest.mark.parametrize('values', [
    {}, {'roi': '20 4 64 56'}, {'downscale': 2}, {'temporal_filter': 0.5, 'roi': '20 4 64 56', 'downscale': 2}])
def test_the_confidence_has_the_size_of_the_disparity(values):
    frame = processed(**values).frame
    confidence = pixels(made(frame, 'confidence'))
    assert confidence.shape == frame.disparity.shape == pixels(made(frame, 'disparity').image).shape
    assert 0 <= confidence.min() < 0.2 < np.median(confidence) <= confidence.max() <= 1


@pytest.mark.parametrize('filled', [True, False])
def test_what_is_averaged_over_time_does_not_depend_on_the_threshold(filled):
    """All that the message may have: with publish_filled the filled-in disparities too."""
    infos = camera_info('left', WIDTH, HEIGHT), camera_info('right', WIDTH, HEIGHT)
    random = np.random.default_rng(8)
    grey = [[np.frombuffer(image.data, np.uint8).reshape(HEIGHT, WIDTH) for image in wall()] for _ in range(2)]
    pairs = [[image_message(np.uint8(np.clip(view + random.normal(0, 9, view.shape), 0, 255))) for view in views]
             for views in grey]

    def last(**values):
        processor = FrameProcessor()
        parameters = NodeParameters().replace({'num_disparities': 16, 'publish_filled': filled, **values})
        for number, pair in enumerate(pairs):
            frame = processor.process(StereoFrame(*pair, *infos, 0.1 * number), parameters).frame
        return frame

    plain, smooth = last(), last(temporal_filter=0.5)
    np.testing.assert_array_equal(smooth.disparity, last(temporal_filter=0.5, confidence_threshold=0.9).disparity)
    np.testing.assert_array_equal(smooth.confidence, plain.confidence)
    changed = smooth.disparity != plain.disparity
    assert changed[smooth.valid].any() and changed[~smooth.valid].any() is np.bool_(filled)
