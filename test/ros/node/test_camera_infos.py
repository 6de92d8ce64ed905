"""Which camera_info belongs to an image of a backlog."""
import threading
import time

from builtin_interfaces.msg import Time
from node_bench import camera_info

from svdm_ros.node.camera_infos import CameraInfos


def stamped(second, width=120):
    info = camera_info('left', width=width)
    info.header.stamp.sec = second
    return info


def test_the_one_of_the_images_stamp_is_taken_else_the_latest():
    infos = CameraInfos()
    assert infos.latest('left') is None and infos.of('left', Time(sec=1)) is None
    for second in range(1, 6):
        infos.take('left', stamped(second, width=100 + second))
    assert infos.of('left', Time(sec=2)).width == 102
    assert infos.of('left', Time(sec=9)).width == infos.latest('left').width == 105
    assert infos.of('right', Time(sec=2)) is None


def test_few_are_kept():
    infos = CameraInfos()
    for second in range(100):
        infos.take('left', stamped(second, width=second))
    assert infos.of('left', Time(sec=60)).width == 99
    assert infos.of('left', Time(sec=70)).width == 70


def test_it_is_waited_for_where_the_image_before_had_its_own():
    infos = CameraInfos()
    infos.take('left', stamped(1, width=101))
    assert infos.of('left', Time(sec=1)).width == 101
    late = threading.Timer(0.02, infos.take, ['left', stamped(2, width=102)])
    late.start()
    assert infos.of('left', Time(sec=2)).width == 102
    late.join()


def test_a_driver_that_stamps_it_otherwise_is_waited_for_once_at_most():
    infos = CameraInfos()
    infos.take('left', stamped(1, width=101))
    infos.of('left', Time(sec=1))
    start = time.monotonic()
    assert [infos.of('left', Time(sec=second)).width for second in range(2, 12)] == [101] * 10
    assert 0.09 < time.monotonic() - start < 0.5
