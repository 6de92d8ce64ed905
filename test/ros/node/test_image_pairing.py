"""How images that wait are limited in bytes, and what is told and counted of them."""
import pytest
from node_bench import image_message, random_dots

from svdm_ros.node import image_pairing
from svdm_ros.node.image_pairing import ImagePairing, most_waiting
from svdm_ros.node.log_lines import LogLines
from svdm_ros.node.parameter_set import NodeParameters

TOPICS = {'left': '/l', 'right': '/r'}


class Recorder:
    def __init__(self):
        self.lines = []

    def info(self, message):
        self.lines.append(message)

    warning = info


@pytest.fixture
def logger():
    return Recorder()


@pytest.fixture
def pairing(logger, monkeypatch):
    monkeypatch.setattr(image_pairing, '_MOST_WAITING', 50_000)  # 4 images of random_dots
    pairing = ImagePairing(LogLines(logger))
    pairing.begin(TOPICS, NodeParameters(queue_size=1000))
    return pairing


def images(side, count):
    pixels = random_dots()[side == 'right']
    messages = [image_message(pixels) for _ in range(count)]
    for second, message in enumerate(messages):
        message.header.stamp.sec = second
    return messages


def test_the_oldest_go_beyond_the_bytes_and_the_others_are_paired(pairing, logger):
    for image in images('left', 10):
        assert pairing.add('left', image) == []
    pairs = [pair.left.header.stamp.sec for image in images('right', 10) for pair in pairing.add('right', image)]
    assert pairs == [6, 7, 8, 9]
    assert pairing.dropped['waiting memory left'] == 6 and pairing.dropped['unpaired left'] == 0
    (line,) = [line for line in logger.lines if 'images of /l that wait' in line]
    assert 'look why /r does not bring their partners' in line


def test_drops_stay_counted_when_the_topics_change(pairing):
    for image in images('left', 10):
        pairing.add('left', image)
    pairing.begin(TOPICS, NodeParameters(queue_size=2))
    for image in images('left', 3):
        pairing.add('left', image)
    assert pairing.dropped['waiting memory left'] == 6 and pairing.dropped['unpaired left'] == 1
    assert pairing.dropped['unpaired right'] == 0


@pytest.mark.parametrize(('free', 'most'), [(None, 512 << 20), (1 << 40, 512 << 20), (800, 100)])
def test_how_much_may_wait_follows_from_free_memory(free, most):
    assert most_waiting(free) == most
