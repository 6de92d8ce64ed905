"""The camera of the soak as a process of its own: good pairs, hostile messages between them, and jumps of time."""
from __future__ import annotations

import argparse
import random
import time
from typing import Any

import rclpy
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from svdm_core.commands.argument_types import size as size_type

from ..processes.camera import camera_info_message, image_message, serve
from .good_pairs import COUNT, Size, frame_id, good_pairs, hostile_calibrations_come
from .hostile_messages import MAKERS, hostile_bytes

_JUMP = 0.002
"""How probable a jump of time is, for each pair."""
_LONGEST_JUMP_NS = 3600 * 10**9
_RAW = 0.4
"""Share of hostile messages that are bytes."""


class SoakCamera:
    """As processes.camera.Camera; rclpy must be up."""

    def __init__(self, size: Size, first: int, seed: int, hostile: int) -> None:
        """size: of the good pairs. first: number of the first pair. hostile: messages after each pair; 0: no jumps of
        time either."""
        self._node = rclpy.create_node('soak_camera')
        self._chance = random.Random(f'{seed} {first}')
        self._number, self._hostile, self._offset = first, hostile, 0
        self._publishers: dict[tuple[str, type], Publisher] = {}
        for side in ('left', 'right'):
            for kind, name in ((CameraInfo, 'camera_info'), (Image, 'image_rect'),
                               (CompressedImage, 'image_rect/compressed')):
                self._publishers[side, kind] = self._node.create_publisher(
                    kind, f'{side}/{name}', qos_profile_sensor_data)
        width, height = size
        self._infos = {side: camera_info_message(side, height, width) for side in ('left', 'right')}
        self._pairs = [dict(zip(('left', 'right'), map(image_message, pair), strict=True)) for pair in good_pairs(size)]

    def has_listeners(self) -> bool:
        """Whether somebody takes the good pairs."""
        return all(publisher.get_subscription_count() > 0 for (_, kind), publisher in self._publishers.items()
                   if kind is not CompressedImage)

    def wait(self, seconds: float) -> None:
        """Answer whatever comes first, for so long at most."""
        rclpy.spin_once(self._node, timeout_sec=seconds)

    def send(self, *, images: bool) -> int:
        """Publish the calibration, with a pair and hostile messages if wanted; the stamp, ns."""
        if self._hostile and self._chance.random() < _JUMP:
            self._offset = self._chance.randrange(-_LONGEST_JUMP_NS, _LONGEST_JUMP_NS)
        now = time.time_ns()
        stamp = now + self._offset
        for side in ('left', 'right'):
            self._publish(side, self._infos[side], stamp)
        if images:
            self._number += 1
            pair = self._number % COUNT
            for side in ('left', 'right'):
                message = self._pairs[pair][side]
                message.header.frame_id = frame_id(self._number, pair, now)
                self._publish(side, message, stamp)
            for _ in range(self._hostile):
                self._publish_hostile()
        return stamp

    def _publish(self, side: str, message: Any, stamp: int) -> None:
        message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
        self._publishers[side, type(message)].publish(message)

    def _publish_hostile(self) -> None:
        kinds = [kind for kind in MAKERS if kind is not CameraInfo or hostile_calibrations_come(time.time_ns())]
        kind = self._chance.choice(kinds)
        message = MAKERS[kind](self._chance)
        data = hostile_bytes(self._chance, message) if self._chance.random() < _RAW else message
        sides = self._chance.choice((['left'], ['right'], ['left', 'right']))
        for side in sides:
            self._publishers[side, kind].publish(data)


def main() -> None:
    """Entry of the process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rate', type=float, required=True, help='pairs a second')
    parser.add_argument('--seed', type=int, required=True)
    parser.add_argument('--first', type=int, default=0, help='number of the first pair')
    parser.add_argument('--hostile', type=int, default=2, help='hostile messages after each pair')
    parser.add_argument('--size', type=size_type, required=True, metavar='WxH', help='of the good pairs, px')
    options = parser.parse_args()
    serve(lambda: SoakCamera(options.size, options.first, options.seed, options.hostile), options.rate)


if __name__ == '__main__':
    main()
