"""Which topics images come on, and what is said where they come on others."""
import pytest

from svdm_ros.node.image_topics import ImageTopics, all_image_topics, other_topics_hint
from svdm_ros.node.parameter_set import NodeParameters

IMAGE, COMPRESSED = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage'
DEFAULT = ImageTopics.of(NodeParameters())


@pytest.mark.parametrize(('values', 'names', 'kind'), [
    ({}, ('left/image_rect', 'right/image_rect'), IMAGE),
    ({'input': 'raw'}, ('left/image_raw', 'right/image_raw'), IMAGE),
    ({'transport': 'compressed'}, ('left/image_rect/compressed', 'right/image_rect/compressed'), COMPRESSED),
    ({'layout': 'side_by_side'}, ('image_rect', 'image_rect'), IMAGE),
    ({'input': 'raw', 'transport': 'compressed', 'layout': 'side_by_side'}, ('image_raw/compressed',) * 2, COMPRESSED)])
def test_topics_follow_the_parameters(values, names, kind):
    topics = ImageTopics.of(NodeParameters(**values))
    assert (topics.name('left'), topics.name('right')) == names and topics.message_type == kind


def test_there_are_eight_ways_with_names_of_their_own():
    ways = list(all_image_topics())
    assert len(ways) == 8 and len({topics.name('left') for topics in ways}) == 8


@pytest.mark.parametrize(('published', 'hint'), [
    ({}, ''),
    ({'left/image_raw': {IMAGE}}, ''),
    ({'left/image_raw': {IMAGE}, 'right/image_raw': {IMAGE}},
     'images are published on left/image_raw and right/image_raw: -p input:=raw takes them'),
    ({'left/image_rect/compressed': {COMPRESSED}, 'right/image_rect/compressed': {COMPRESSED}},
     'images are published on left/image_rect/compressed and right/image_rect/compressed: -p transport:=compressed '
     'takes them'),
    ({'image_raw': {IMAGE}}, 'images are published on image_raw: -p input:=raw -p layout:=side_by_side takes them'),
    ({'left/image_rect': {'std_msgs/msg/String'}},
     f'left/image_rect is published as std_msgs/msg/String, and this node takes {IMAGE} there'),
    ({'left/image_raw': {COMPRESSED}, 'right/image_raw': {COMPRESSED}}, '')])
def test_what_is_published_instead_is_told_with_the_parameters_that_take_it(published, hint):
    assert other_topics_hint(DEFAULT, lambda name: published.get(name, set())) == hint


def test_of_two_possibilities_the_nearer_one_is_told():
    published = {f'{side}/image_{kind}{end}': {COMPRESSED if end else IMAGE}
                 for side in ('left', 'right') for kind in ('raw', 'rect') for end in ('', '/compressed')}
    del published['left/image_rect']
    hint = other_topics_hint(DEFAULT, lambda name: published.get(name, set()))
    assert hint.count('-p ') == 1
