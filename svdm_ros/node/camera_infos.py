"""camera_info of both cameras: the subscriptions, and which message belongs to an image."""
from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING

from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo

from .image_topics import SIDES
from .quality_of_service import is_latched, latched_qos

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time

    from ..frames.stereo_pairing import SideName

_KEPT = 32
"""A camera_info a side for each image of a backlog."""
_PATIENCE = 0.1  # s


class CameraInfos:
    """Those that came of late. Taken by one thread, asked for by another."""

    def __init__(self) -> None:
        self._infos: dict[SideName, deque[CameraInfo]] = {side: deque(maxlen=_KEPT) for side in SIDES}
        self._stamped_alike = dict.fromkeys(SIDES, False)
        self._came = threading.Condition()

    def take(self, side: SideName, info: CameraInfo) -> None:
        with self._came:
            self._infos[side].appendleft(info)
            self._came.notify()

    def latest(self, side: SideName) -> CameraInfo | None:
        """The last one that came; None before there is one."""
        with self._came:
            return next(iter(self._infos[side]), None)

    def latest_of_both(self) -> list[CameraInfo | None]:
        """The last one of each side."""
        return [self.latest(side) for side in SIDES]

    def of(self, side: SideName, stamp: Time) -> CameraInfo | None:
        """The one with the stamp of the image; where there is none, the latest: not every driver stamps it alike.

        Where the image before had its own, it is waited for, 0.1 s at most: in a backlog, images may be taken first.
        """
        with self._came:
            patience = _PATIENCE if self._stamped_alike[side] else 0.0
            self._stamped_alike[side] = self._came.wait_for(lambda: self._same(side, stamp) is not None, patience)
            return self._same(side, stamp) or next(iter(self._infos[side]), None)

    def _same(self, side: SideName, stamp: Time) -> CameraInfo | None:
        return next((info for info in self._infos[side] if info.header.stamp == stamp), None)


type Taker = Callable[[CameraInfo], None]


class CameraInfoSubscriptions:
    """Takes camera_info while it is wanted; what was latched before this node came as well."""

    def __init__(self, node: Node, take: Callable[[SideName, CameraInfo], None],
                 subscribe: Callable[[type[CameraInfo], str, Taker], Subscription]) -> None:
        """subscribe: makes a subscription of a type and a name."""
        self._node, self._take, self._subscribe = node, take, subscribe
        self._subscriptions: dict[SideName, Subscription] = {}
        self._latched: set[SideName] = set()

    def begin(self) -> None:
        for side in SIDES:
            if side not in self._subscriptions:
                self._subscriptions[side] = self._subscribe(
                    CameraInfo, f'{side}/camera_info', partial(self._take, side))

    def end(self, side: SideName) -> None:
        if side in self._subscriptions:
            self._node.destroy_subscription(self._subscriptions.pop(side))

    def ask_for_latched(self, side: SideName) -> None:
        """What was latched before this node came reaches only who asks for it, and who asks gets nothing else."""
        name = f'{side}/camera_info'
        publishers = self._node.get_publishers_info_by_topic(name)
        if side not in self._latched and any(map(is_latched, publishers)):
            self._latched.add(side)
            self._node.create_subscription(CameraInfo, name, partial(self._take, side), latched_qos(),
                                           event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))
