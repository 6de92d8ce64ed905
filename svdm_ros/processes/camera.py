"""A camera as a process of its own: the same pair again and again, with the time of sending as stamp."""
from __future__ import annotations

import argparse
import array
import math
import os
import signal
import threading
import time
from collections.abc import Callable
from typing import Protocol

import cv2
import numpy as np
import rclpy
from numpy.typing import NDArray
from rclpy.publisher import Publisher
from rclpy.qos import qos_profile_sensor_data
from rclpy.signals import SignalHandlerOptions
from sensor_msgs.msg import CameraInfo, Image

from .scene import MOTORCYCLE, load_scene

FRAME_ID = 'camera_left_optical'
CALIBRATION_ONLY = 1.0  # s
LINGER = 0.2  # s; for the last pair to be taken
SENT = 'sent '  # starts the line printed for each pair; its stamp in ns follows


def image_message(pixels: NDArray[np.uint8]) -> Image:
    """A bgr8 message of pixels (H, W, 3), or mono8 of (H, W)."""
    height, width = pixels.shape[:2]
    data = array.array('B', pixels.tobytes())  # any other type is copied element by element: 100 times slower
    encoding = 'mono8' if pixels.ndim == 2 else 'bgr8'
    image = Image(height=height, width=width, encoding=encoding, step=pixels.strides[0], data=data)
    image.header.frame_id = FRAME_ID
    return image


def camera_info_message(side: str, height: int, width: int) -> CameraInfo:
    """Calibration of the 'left' or the 'right' camera of MOTORCYCLE: rectified already, so no distortion."""
    p = MOTORCYCLE.projection(side)
    info = CameraInfo(height=height, width=width, distortion_model='plumb_bob', d=[0.0] * 5)
    info.k = [value for row in (p[0:3], p[4:7], p[8:11]) for value in row]
    info.r = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0]
    info.p = p
    info.header.frame_id = FRAME_ID
    return info


class Camera:
    """Publishes left and right, image and camera_info; rclpy must be up."""

    def __init__(self, size: tuple[int, int] | None = None) -> None:
        """size: width and height in px, of grey images; None for the colour images as they are."""
        self._node = rclpy.create_node('demo_camera')
        scene = load_scene()
        self._infos: list[tuple[Publisher, CameraInfo]] = []
        self._images: list[tuple[Publisher, Image]] = []
        for side, pixels in (('left', scene.left), ('right', scene.right)):
            if size is not None:
                grey = cv2.cvtColor(pixels, cv2.COLOR_BGR2GRAY)
                pixels = np.asarray(cv2.resize(grey, size, interpolation=cv2.INTER_AREA), np.uint8)
            height, width = pixels.shape[:2]
            info_output = self._node.create_publisher(CameraInfo, f'{side}/camera_info', qos_profile_sensor_data)
            image_output = self._node.create_publisher(Image, f'{side}/image_rect', qos_profile_sensor_data)
            self._infos.append((info_output, camera_info_message(side, height, width)))
            self._images.append((image_output, image_message(pixels)))

    def has_listeners(self) -> bool:
        """Whether every topic has a subscriber."""
        return all(publisher.get_subscription_count() > 0 for publisher, _ in (*self._infos, *self._images))

    def wait(self, seconds: float) -> None:
        """Answer whatever comes first, for so long at most."""
        rclpy.spin_once(self._node, timeout_sec=seconds)

    def send(self, *, images: bool) -> int:
        """Publish the calibration, with the pair if wanted; returns the stamp in ns, the wall clock at the call."""
        stamp = time.time_ns()
        for publisher, message in (*self._infos, *self._images) if images else self._infos:
            message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp, 10**9)
            publisher.publish(message)
        return stamp


class Sender(Protocol):
    """What `run` and `serve` need of a camera; see Camera."""

    def has_listeners(self) -> bool: ...
    def wait(self, seconds: float) -> None: ...
    def send(self, *, images: bool) -> int: ...


def run(camera: Sender, rate: float, stop: threading.Event) -> None:
    """Send at `rate` Hz until `stop` is set or the parent is gone.

    Calibration only at first: images follow when every topic has had a listener for CALIBRATION_ONLY s, so that the
    node knows the calibration with the first pair, and has learnt of this camera as this camera has of the node.
    """
    parent = os.getppid()
    due, images_from = time.monotonic(), math.inf
    while not stop.is_set() and os.getppid() == parent:
        camera.wait(max(0.0, due - time.monotonic()))
        now = time.monotonic()
        if now < due:
            continue
        due = max(due + 1 / rate, now)
        if images_from == math.inf and camera.has_listeners():
            images_from = now + CALIBRATION_ONLY
        stamp = camera.send(images=now >= images_from)
        if now >= images_from:
            print(f'{SENT}{stamp}', flush=True)
    camera.wait(LINGER)


def serve(make: Callable[[], Sender], rate: float) -> None:
    """Make a camera, and run it until SIGINT or SIGTERM."""
    stop = threading.Event()  # no exception: it could come between sending and counting
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda *_: stop.set())
    rclpy.init(signal_handler_options=SignalHandlerOptions.NO)
    run(make(), rate, stop)
    rclpy.shutdown()


def main() -> None:
    """Entry of the process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument('--rate', type=float, default=10.0, help='pairs a second')
    parser.add_argument('--size', type=int, nargs=2, metavar=('W', 'H'), help='grey images of this size, px')
    options = parser.parse_args()
    serve(lambda: Camera(tuple(options.size) if options.size else None), options.rate)


if __name__ == '__main__':
    main()
