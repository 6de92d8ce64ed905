"""What the demo takes from the node beside the disparity: depth in metres and the points."""
from __future__ import annotations

import dataclasses
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import Image, PointCloud2

from ..processes.session import Session


class Space(NamedTuple):
    """depth: float32 (H, W), m, NaN unknown. points: float32 (N, 3), m, x to the right, y down, z ahead of the left
    camera. colours: uint8 (N, 3), red, green, blue."""

    depth: NDArray[np.float32]
    points: NDArray[np.float32]
    colours: NDArray[np.uint8]


@dataclasses.dataclass
class DepthView:
    """Listens to `depth/image_rect` and `points2` from its making on; keeps the newest of each."""

    session: Session
    depth: Image | None = None
    points: PointCloud2 | None = None

    def __post_init__(self) -> None:
        self.session.subscribe(Image, 'depth/image_rect', self._take_depth)
        self.session.subscribe(PointCloud2, 'points2', self._take_points)

    def wait(self, after: int, timeout: float) -> Space:
        """Of one pair whose stamp is later than `after` (ns). RunError where none comes within `timeout` s."""
        self.session.wait_for(lambda: self._newest() > after, timeout, 'no depth and points of one pair arrived')
        assert self.depth is not None and self.points is not None
        depth = np.frombuffer(self.depth.data, np.float32).reshape(self.depth.height, self.depth.width)
        fields = np.frombuffer(self.points.data, np.float32).reshape(-1, 4)
        known = np.isfinite(fields[:, 2])
        packed = fields[known, 3].view(np.uint8).reshape(-1, 4)  # blue, green, red, 0
        return Space(depth, fields[known, :3], packed[:, 2::-1])

    def _newest(self) -> int:
        """ns; the stamp of both, 0 where they are of different pairs."""
        stamps = [message.header.stamp for message in (self.depth, self.points) if message is not None]
        return stamps[0].sec * 10**9 + stamps[0].nanosec if len(stamps) == 2 and stamps[0] == stamps[1] else 0

    def _take_depth(self, message: Image) -> None:
        self.depth = message

    def _take_points(self, message: PointCloud2) -> None:
        self.points = message
