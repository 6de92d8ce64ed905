"""From messages to matched frames: raw, compressed and side-by-side images come to what separate ones come to."""
import functools
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from node_bench import image_message
from planes import camera_info, render
from sensor_msgs.msg import CompressedImage

from svdm_ros.calibration.rectification import Rectification
from svdm_ros.frames.frame_processing import FrameProcessor
from svdm_ros.frames.messages import rclpy_types
from svdm_ros.frames.outputs import OUTPUTS
from svdm_ros.frames.temporal_filter import TemporalFilter
from svdm_ros.frames.views import FrameError, StereoFrame, Views
from svdm_ros.node.parameter_set import NodeParameters

SIZE, F, BASELINE = (376, 240), 218.0, 0.11
LENSES = {'plumb_bob': [-0.28, 0.07, 0.0002, 1e-5], 'equidistant': [-0.01, 0.02, -0.015, 0.004]}


def camera(side, model='plumb_bob'):
    """Half the size of a camera of EuRoC, turned a little."""
    left = side == 'left'
    k = [229.0, 228.5, 183.5, 124.0] if left else [228.5, 228.0, 189.5, 127.5]
    if model == 'equidistant':
        k[:2] = [190.0, 190.5]
    turn = (0.012, -0.025, 0.008) if left else (-0.01, 0.02, -0.015)
    p = (F, 185.0, 122.5, 0.0) if left else (F, 182.5, 122.5, -F * BASELINE)
    return camera_info(SIZE, model, LENSES[model], k, turn, p)


@functools.cache
def raw_pixels(side, model='plumb_bob'):
    return render(camera(side, model), raw=True)[0]


def raw_frame(model='plumb_bob', message=image_message):
    images = (message(raw_pixels(side, model)) for side in ('left', 'right'))
    return StereoFrame(*images, *(camera(side, model) for side in ('left', 'right')), 0.0, raw=True)


def png(pixels):
    return CompressedImage(format='mono8; png compressed', data=cv2.imencode('.png', pixels)[1].tobytes())


def processed(frame, **values):
    return FrameProcessor().process(frame, NodeParameters().replace({
        'num_disparities': 64, 'input': 'raw' if frame.raw else 'rectified', **values}))


@pytest.mark.parametrize('model', LENSES)
@pytest.mark.parametrize('values', [{}, {'roi': '100, 40, 250, 180'}, {'downscale': 2}])
def test_raw_images_give_the_true_depth(model, values):
    frame = processed(raw_frame(model), **values).frame
    _, truth = render(camera('left', model), raw=False)
    factor = values.get('downscale', 1)
    if 'roi' in values:
        truth = truth[40:220, 100:350]
    truth = cv2.resize(truth, None, fx=1 / factor, fy=1 / factor, interpolation=cv2.INTER_AREA)
    inside = np.s_[12:-12, 60:-12]
    error = np.abs(frame.depth - truth)[inside] / truth[inside]
    right = error < 0.05 * factor  # the disparity is right: within about 1 px
    assert right.mean() > 0.98
    assert np.mean(error[right] < 0.01 * factor) > 0.97
    assert np.median(error) < 0.004 * factor


def test_compressed_images_give_the_same_bytes():
    plain, packed = processed(raw_frame()).frame, processed(raw_frame(message=png)).frame
    for output in OUTPUTS:
        messages = [output.make(frame, rclpy_types()) for frame in (plain, packed)]
        data = [getattr(getattr(message, 'image', message), 'data', message) for message in messages]
        assert data[0] == data[1], output.topic


def test_halves_of_one_image_give_the_same_bytes():
    both = image_message(np.hstack([raw_pixels('left'), raw_pixels('right')]))
    infos = [camera(side) for side in ('left', 'right')]
    whole = processed(StereoFrame(both, both, *infos, 0.0, raw=True)).frame
    apart = processed(raw_frame()).frame
    assert whole.disparity.tobytes() == apart.disparity.tobytes()
    assert whole.depth.tobytes() == apart.depth.tobytes()


def test_the_rectified_left_image_goes_out_as_it_was_matched():
    frame = processed(raw_frame()).frame
    expected = Rectification.of(camera('left'), *SIZE)(raw_pixels('left'))
    message = next(output.make(frame, rclpy_types()) for output in OUTPUTS if output.topic == 'left/image_rect')
    assert message.encoding == 'mono8'
    assert np.frombuffer(message.data, np.uint8).tobytes() == expected.tobytes()


def without_right_info():
    frame = raw_frame()
    return StereoFrame(frame.left, frame.right, frame.left_info, None, 0.0, raw=True)


def with_odd_width():
    both = image_message(np.zeros((10, 21), np.uint8))
    return StereoFrame(both, both, None, None, 0.0)


def with_damage():
    return StereoFrame(CompressedImage(format='png', data=b'abc'), png(raw_pixels('right')), None, None, 0.0)


def uncalibrated():
    frame = raw_frame()
    frame.left_info.k[0] = 0.0
    return frame


@pytest.mark.parametrize(('frame', 'reason', 'told'), [
    (without_right_info, 'not calibrated', 'no right/camera_info has come'),
    (uncalibrated, 'not rectified', 'left/camera_info cannot rectify it: '),
    (with_odd_width, 'unreadable', 'its width must be even'),
    (with_damage, 'unreadable', 'left image dropped: ')])
def test_what_cannot_be_used_is_told(frame, reason, told):
    with pytest.raises(FrameError) as caught:
        Views().of(frame())
    assert caught.value.reason == reason and told in str(caught.value) and '\n' not in str(caught.value)


def test_maps_follow_a_calibration_that_changes():
    views, frame = Views(), raw_frame()
    before = views.of(frame)[0].pixels
    frame.left_info.d[0] = -0.1
    after = views.of(frame)[0].pixels
    assert (before != after).any()
    assert after.tobytes() == Rectification.of(frame.left_info, *SIZE)(raw_pixels('left')).tobytes()


@pytest.mark.parametrize(('gain', 'offset', 'told'), [(1.0, 0, False), (0.6, 10, True), (1.1, 5, False)])
def test_exposure_match_makes_a_darker_right_image_like_the_left(gain, offset, told):
    left, right = (Rectification.of(camera(side), *SIZE)(raw_pixels(side)) for side in ('left', 'right'))
    other = np.uint8(np.clip(gain * right.astype(float) + offset, 0, 255))
    infos = [camera(side) for side in ('left', 'right')]
    for info in infos:
        info.d, info.r = [], np.eye(3).ravel()

    def disparity(right, **values):
        done = processed(StereoFrame(image_message(left), image_message(right), *infos, 0.0), **values)
        return done.frame.disparity[12:-12, 60:-12], done.problem

    same, _ = disparity(right)
    evened, problem = disparity(other, exposure_match='gain')
    assert np.mean(np.abs(evened - same) < 1) > 0.98
    assert ('exposures of the two images differ much' in problem) is told


def naive_temporal(frames, weight):
    mean, results = None, []
    for disparity, known in frames:
        result = disparity.astype(np.float64)
        for at in np.ndindex(*disparity.shape):
            past = None if mean is None else mean[at]
            if past is not None and known[at] and abs(past - result[at]) <= 1:
                result[at] = weight * past + (1 - weight) * result[at]
        mean = {at: (result[at] if known[at] else None) for at in np.ndindex(*disparity.shape)}
        results.append(result)
    return results


def test_the_temporal_filter_is_a_mean_that_forgets_at_jumps():
    random = np.random.default_rng(2)
    frames = [(np.float32(10 + random.normal(0, 0.4, (6, 7)) + 5 * (n == 6)), random.random((6, 7)) > 0.2)
              for n in range(12)]
    temporal = TemporalFilter()
    for now, ((disparity, known), expected) in enumerate(zip(frames, naive_temporal(frames, 0.7), strict=True)):
        np.testing.assert_allclose(temporal(disparity, known, 0.7, now / 10, 'same'), expected, rtol=1e-5)


@pytest.mark.parametrize('calls', [
    [(0.7, 0.0, 'a'), (0.7, 0.1, 'b')], [(0.7, 0.0, 'a'), (0.0, 0.1, 'a'), (0.7, 0.2, 'a')],
    [(0.7, 0.0, 'a'), (0.7, 1.5, 'a')], [(0.7, 5.0, 'a'), (0.7, 4.9, 'a')]],
    ids=['another setting', 'off and on', 'a pause', 'time goes back'])
def test_the_temporal_filter_forgets(calls):
    temporal, known = TemporalFilter(), np.ones((3, 4), bool)
    for k, (weight, now, setting) in enumerate(calls):
        disparity = np.full((3, 4), 10 + 0.3 * k, np.float32)
        result = temporal(disparity, known, weight, now, setting)
    np.testing.assert_array_equal(result, disparity)


@pytest.mark.parametrize('values', [
    {'roi': '100, 40, 250, 180'}, {'temporal_filter': 0.0}, {'num_disparities': 60}])
def test_the_past_ends_where_parameters_change_what_it_means(values):
    processor, start = FrameProcessor(), {'num_disparities': 64, 'input': 'raw', 'temporal_filter': 0.9,
                                          'roi': '90, 30, 250, 180'}
    frame = raw_frame()
    processor.process(frame, NodeParameters().replace(start))
    noisy = image_message(np.roll(raw_pixels('right'), 1, axis=1))
    moved = StereoFrame(frame.left, noisy, frame.left_info, frame.right_info, 0.1, raw=True)
    changed = NodeParameters().replace({**start, **values})
    result = processor.process(moved, changed).frame.disparity
    if values.get('temporal_filter') == 0.0:
        result = processor.process(moved, NodeParameters().replace(start)).frame.disparity
        changed = NodeParameters().replace(start)
    assert result.tobytes() == FrameProcessor().process(moved, changed).frame.disparity.tobytes()


def test_the_temporal_filter_makes_a_noisy_wall_steadier():
    processor = FrameProcessor()
    parameters = NodeParameters().replace({'num_disparities': 64, 'input': 'raw', 'temporal_filter': 0.8})
    maps = []
    for n in range(6):
        noise = np.random.default_rng(n)
        images = (image_message(np.uint8(np.clip(raw_pixels(side) + noise.normal(0, 4, SIZE[::-1]), 0, 255)))
                  for side in ('left', 'right'))
        frame = StereoFrame(*images, camera('left'), camera('right'), n / 10, raw=True)
        maps.append([processor.process(frame, parameters).frame.disparity,
                     processed(frame).frame.disparity])
    smoothed, plain = (np.std([pair[k] for pair in maps[2:]], axis=0)[12:-12, 60:-12] for k in (0, 1))
    assert np.median(smoothed) < 0.6 * np.median(plain)


def test_parts_of_another_image_are_views_not_copies():
    both = image_message(np.zeros((4, 6), np.uint8))
    left, right = Views().of(StereoFrame(both, both, SimpleNamespace(width=0, height=0, binning_x=0, binning_y=0), None,
                                         0.0))
    assert left.pixels.shape == right.pixels.shape == (4, 3)
