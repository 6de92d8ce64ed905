"""Which topics are taken for the stereo pair, and what is said where there is no single one."""
import pytest

from svdm_ros.bags.reading.recording import RecordingError, Topic
from svdm_ros.bags.reading.stereo_topics import find_side_by_side, find_stereo_topics

KINDS = {'image': 'sensor_msgs/msg/Image', 'compressed': 'sensor_msgs/msg/CompressedImage',
         'info': 'sensor_msgs/msg/CameraInfo', 'disparity': 'stereo_msgs/msg/DisparityImage'}


def topics(count=5, **names):
    return {name: Topic(name, KINDS[kind], count) for kind, those in names.items() for name in those.split()}


@pytest.mark.parametrize(('images', 'left', 'right'), [
    ('/cam/left/image_rect /cam/right/image_rect', '/cam/left/image_rect', '/cam/right/image_rect'),
    ('/left /right /rgb/image', '/left', '/right'),
    ('/camera/infra1/image_rect_raw /camera/infra2/image_rect_raw', '/camera/infra1/image_rect_raw',
     '/camera/infra2/image_rect_raw'),
    ('/cam0/image_raw /cam1/image_raw', '/cam0/image_raw', '/cam1/image_raw'),
    ('/left/image_raw /right/image_raw /left/image_rect /right/image_rect', '/left/image_rect', '/right/image_rect'),
])
def test_the_only_pair_is_found_and_a_rectified_one_preferred(images, left, right):
    found = find_stereo_topics(topics(image=images))
    assert (found.left, found.right, found.infos, found.ground_truth) == (left, right, [], None)


def test_the_plain_images_come_before_their_compressed_copies():
    both = topics(image='/left/image /right/image', compressed='/left/image/compressed /right/image/compressed')
    assert find_stereo_topics(both).left == '/left/image'
    only = topics(compressed='/left/image/compressed /right/image/compressed', info='/left/camera_info')
    found = find_stereo_topics(only)
    assert (found.left, found.left_info, found.right_info) == ('/left/image/compressed', '/left/camera_info', None)


def test_camera_info_and_ground_truth_are_found():
    found = find_stereo_topics(topics(
        image='/a/left/image_rect /a/right/image_rect', info='/a/left/camera_info /a/right/camera_info /b/camera_info',
        disparity='/ground_truth/disparity /other/disparity'))
    assert found.infos == ['/a/left/camera_info', '/a/right/camera_info']
    assert found.ground_truth == '/ground_truth/disparity'


TWO = '/front/left/image_rect /front/right/image_rect /rear/left/image_rect /rear/right/image_rect'


def test_named_topics_are_taken():
    found = find_stereo_topics(topics(image=TWO), '/rear/left/image_rect', '/rear/right/image_rect')
    assert found.left == '/rear/left/image_rect'


@pytest.mark.parametrize(('there', 'named', 'told'), [
    (topics(info='/camera_info'), {}, r'no images in it: it holds /camera_info \(CameraInfo, 5\)'),
    ({}, {}, 'no images in it: it is empty'),
    (topics(image='/left /right', count=0), {}, 'no images in it'),
    (topics(image='/cam/left/image'), {}, 'only one side: images on /cam/left/image but none on /cam/right/image'),
    (topics(image='/front /back'), {}, r'no stereo pair found by name.*/back \(Image, 5\), /front'),
    (topics(image=TWO), {}, '2 stereo pairs in it, choose one: --left /front/left/image_rect --right /front/right/.*; '
                            '--left /rear'),
    (topics(image=TWO), {'left': '/front/left/image_rect'}, '--left and --right belong together'),
    (topics(image=TWO), {'left': '/x', 'right': '/y'}, 'no images on /x: there are images on /front/left'),
    (topics(image=TWO), {'left': '/x', 'right': '/x'}, 'are both /x'),
])
def test_where_there_is_no_single_pair_it_says_what_there_is(there, named, told):
    with pytest.raises(RecordingError, match=told) as caught:
        find_stereo_topics(there, **named)
    assert '\n' not in str(caught.value)


def test_raw_images_come_first_where_they_are_wanted():
    both = topics(image='/left/image_raw /right/image_raw /left/image_rect /right/image_rect')
    assert find_stereo_topics(both).left == '/left/image_rect'
    assert find_stereo_topics(both, raw=True).left == '/left/image_raw'


@pytest.mark.parametrize(('raw', 'wanted'), [(False, '/a/image_rect'), (True, '/a/image_raw')])
def test_the_topic_of_both_views_is_found_with_the_camera_infos_below_it(raw, wanted):
    found = find_side_by_side(topics(
        image='/a/image_rect /a/image_raw', compressed='/a/image_rect/compressed /a/image_raw/compressed',
        info='/a/camera_info /a/left/camera_info /a/right/camera_info'), raw=raw)
    assert (found.left, found.right, found.infos) == (wanted, wanted, ['/a/left/camera_info', '/a/right/camera_info'])


def test_several_topics_that_may_hold_both_views_are_listed():
    there = topics(image='/a/image_raw /b/image_raw')
    with pytest.raises(RecordingError, match=r'2 topics may hold .* --left: it holds /a/image_raw .*, /b/image_raw'):
        find_side_by_side(there)
    assert find_side_by_side(there, '/b/image_raw').right == '/b/image_raw'
    with pytest.raises(RecordingError, match='no images on /c: there are images on /a/image_raw, /b/image_raw'):
        find_side_by_side(there, '/c')
    with pytest.raises(RecordingError, match='no images in it'):
        find_side_by_side(topics(info='/camera_info'))
