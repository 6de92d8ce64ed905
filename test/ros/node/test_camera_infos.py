"""Which camera_info belongs to an image of a backlog."""
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
