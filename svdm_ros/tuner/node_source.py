"""A live node: its outputs are watched, its parameters moved by its parameter services."""
from __future__ import annotations

import collections
import contextlib
import math
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus
from numpy.typing import NDArray
from rcl_interfaces.msg import ParameterEvent
from rclpy.context import Context
from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
from rclpy.node import Node
from rclpy.parameter import Parameter, parameter_value_to_python
from rclpy.parameter_client import AsyncParameterClient
from rclpy.signals import SignalHandlerOptions
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image
from stereo_msgs.msg import DisparityImage

from svdm_core.kernels.arrays import Float32
from svdm_core.shown import line

from ..frames.image_conversion import pixels_of
from ..frames.matched_frame import END_MARGIN
from ..frames.side_by_side import halves
from ..frames.stereo_pairing import StereoPairer
from ..frames.views import StereoFrame, image_pixels
from ..node.image_pairing import stamp_ns
from ..node.image_topics import SIDES, ImageTopics
from ..node.parameter_set import NodeParameters, Value, node_parameter_table
from ..node.quality_of_service import sensor_qos
from ..processes.dds_profile import image_profile
from .live_figures import LiveFigures
from .shot import Shot

_ANSWER = 5.0
"""s, for a parameter service to answer."""
_HOLD = 3.0
"""s, for a pair to come."""
_ASK_AGAIN = 3.0
"""s after which the parameters are read once more."""
_LOOK = 0.5
"""s between two looks whether the node is there."""
_SILENT = 3.0
"""s without a disparity, after which that is told; and for which a message that could not be shown is."""
_KEPT, _LEFTS_KEPT = 8, 40
"""Messages of a kind that wait for those of the same stamp; left images, which come before their disparity."""
_NAMES = tuple(info.name for info in node_parameter_table())
_TOLD = {'rate (Hz)': 'rate', 'latency p50 (ms)': 'latency, median', 'valid pixels (%)': 'valid pixels',
         'vertical offset (px)': 'vertical offset'}
"""Of the diagnostics, with the names of the page; the unit is behind the value there."""


class NodeSource:
    """A Source that listens to a node. It never waits for the browser, nor does the node for it."""

    plays = False
    is_playing = True

    def __init__(self, node_name: str, ros_arguments: Sequence[str]) -> None:
        """node_name: full name, /disparity_node. ros_arguments: remappings of the topics, as the node's."""
        self.title = f'node {node_name}'
        self._name, self._arguments = node_name, ros_arguments
        self._values: dict[str, Value] = {}
        self._shot: Shot | None = None
        self._figures = LiveFigures()
        self._own: dict[str, str] = {}
        self._diagnosed: dict[str, str] = {}
        self._complaint = ''
        self._odd = -math.inf, ''
        self._is_there = False
        self._asked = 0.0
        self._moving = threading.Lock()
        self._came = time.monotonic()
        self._lefts: collections.deque[tuple[int, NDArray[Any]]] = collections.deque(maxlen=_LEFTS_KEPT)
        self._confidences: collections.deque[tuple[int, Float32]] = collections.deque(maxlen=_KEPT)
        self._disparities: collections.deque[DisparityImage] = collections.deque(maxlen=_KEPT)
        self._left: Subscription | None = None
        self._left_topic: tuple[str, str] = ('', '')

    # For any thread

    def start(self) -> None:
        """ValueError where the arguments are none of ROS."""
        self._context = Context()
        try:
            rclpy.init(args=[*self._arguments], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        except RuntimeError as error:
            raise ValueError(f'the arguments behind --ros-args are not understood: {error}') from None
        with image_profile():
            self._node: Node = rclpy.create_node('svdm_tuner', context=self._context)
        self._executor = SingleThreadedExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._client = AsyncParameterClient(self._node, self._name)
        self._node.create_subscription(DisparityImage, 'disparity', self._take_disparity, sensor_qos())
        self._node.create_subscription(Image, 'confidence', self._take_confidence, sensor_qos())
        self._node.create_subscription(DiagnosticArray, '/diagnostics', self._take_diagnostics, 10)
        self._node.create_subscription(ParameterEvent, '/parameter_events', self._take_event, 10)
        self._node.create_timer(_LOOK, self._look)
        self._thread = threading.Thread(target=self._spin, name='tuner', daemon=True)
        self._thread.start()

    def stop(self) -> None:
        self._context.try_shutdown()
        self._thread.join(1.0)

    def values(self) -> Mapping[str, Value]:
        return self._values

    def change(self, values: Mapping[str, Value]) -> str:
        if not self._is_there:
            return f'{self._name} is not there'
        result = self._ask(lambda: self._client.set_parameters_atomically(
            [Parameter(name, value=value) for name, value in values.items()]))
        if result is None:
            return f'{self._name} does not answer'
        if not result.result.successful:
            return str(result.result.reason)
        self._merge(values)
        return ''

    def latest(self) -> Shot | None:
        return self._shot

    def figures(self) -> Mapping[str, str]:
        return {**self._diagnosed, **self._own}

    def trouble(self) -> str:
        if not self._is_there:
            return f'{self._name} is not there: start it, or name it with --node; it is waited for'
        if not self._values:
            return f'{self._name} has not told its parameters yet'
        since, odd = self._odd
        if time.monotonic() - since < _SILENT:
            return odd
        if time.monotonic() - self._came > _SILENT:
            return self._complaint or f'no disparity from {self._name}: do images come to it?'
        return self._complaint

    def hold(self) -> StereoFrame | None:
        """The next pair that comes to the node."""
        holding = _Holding(self._node, self._parameters())
        try:
            holding.done.wait(_HOLD)
            return holding.frame
        finally:
            holding.end()

    def play(self, *, on: bool) -> None:
        """A live node goes on."""

    def step(self) -> None:
        """A live node goes on."""

    def _merge(self, changed: Mapping[str, Value]) -> None:
        """Into what is known; what is not known in whole is asked for."""
        with self._moving:
            if self._values:
                self._values = {**self._values, **changed}

    def _ask(self, call: Callable[[], Any]) -> Any:
        """What a service answers; None where it does not in time."""
        answered = threading.Event()
        future = call()
        future.add_done_callback(lambda _: answered.set())
        return future.result() if answered.wait(_ANSWER) else None

    def _parameters(self) -> NodeParameters:
        return NodeParameters().replace(self._values)

    # In the executor's thread

    def _spin(self) -> None:
        while self._context.ok():
            try:
                self._executor.spin_once(timeout_sec=0.5)
            except ExternalShutdownException:
                return
            except Exception as error:  # of one message, which others may follow
                self._odd = time.monotonic(), f'a message could not be shown: {line(error)}'

    def _look(self) -> None:
        """Whether the node is there, and what it has for parameters."""
        is_there = self._client.services_are_ready()
        now = time.monotonic()
        if not is_there:
            self._values = {}
        elif not self._values or now - self._asked > _ASK_AGAIN:  # another node of that name may have come
            self._asked = now
            self._client.get_parameters([*_NAMES]).add_done_callback(self._take_values)
        self._is_there = is_there

    def _take_values(self, future: Any) -> None:
        found = {name: parameter_value_to_python(value)
                 for name, value in zip(_NAMES, future.result().values, strict=False)}
        self._values = {name: value for name, value in found.items() if value is not None}
        self._watch_left()

    def _take_event(self, event: ParameterEvent) -> None:
        if event.node != self._name or not self._values:
            return
        changed = {change.name: parameter_value_to_python(change.value)
                   for change in (*event.new_parameters, *event.changed_parameters) if change.name in _NAMES}
        self._merge(changed)
        self._watch_left()

    def _watch_left(self) -> None:
        """Listen to what the disparity belongs to: the rectified image of raw ones, or else what comes to the node."""
        topics = ImageTopics.of(self._parameters())
        wanted = ('left/image_rect', Image) if topics.input == 'raw' else (
            topics.name('left'), CompressedImage if topics.transport == 'compressed' else Image)
        if (wanted[0], wanted[1].__name__) == self._left_topic:
            return
        if self._left is not None:
            self._node.destroy_subscription(self._left)
        self._left_topic = wanted[0], wanted[1].__name__
        together = topics.together and topics.input != 'raw'

        def take(message: Any) -> None:
            with contextlib.suppress(ValueError):  # the node tells what is wrong with it
                pixels = image_pixels(message)[0]
                self._lefts.append((stamp_ns(message), halves(pixels)[0] if together else pixels))

        self._left = self._node.create_subscription(wanted[1], wanted[0], take, sensor_qos())

    def _take_confidence(self, message: Image) -> None:
        self._confidences.append((stamp_ns(message), pixels_of(message)))
        self._combine()

    def _take_disparity(self, message: DisparityImage) -> None:
        self._came = time.monotonic()
        self._disparities.append(message)
        self._combine()

    def _combine(self) -> None:
        """A shot of the newest disparity whose confidence has come; of the newest but two, whether it has or not."""
        confidences = dict(self._confidences)
        for place, message in enumerate(reversed(self._disparities)):
            stamp = stamp_ns(message)
            if stamp in confidences or place == 2:
                self._disparities = collections.deque(
                    (later for later in self._disparities if stamp_ns(later) > stamp), maxlen=_KEPT)
                self._show(message, confidences.get(stamp))
                return

    def _show(self, message: DisparityImage, confidence: Float32 | None) -> None:
        disparity = pixels_of(message.image)
        lefts = dict(self._lefts)
        newest = self._lefts[-1][1] if self._lefts else np.zeros(disparity.shape, np.uint8)
        left = lefts.get(stamp_ns(message), newest)
        known = disparity >= message.min_disparity  # as stereo_msgs defines it
        trusted = known
        if confidence is not None and confidence.shape == disparity.shape:
            trusted = known & (confidence >= np.float32(self._values.get('confidence_threshold', 0.0)))
        limits = message.min_disparity + END_MARGIN, message.max_disparity - END_MARGIN
        number = 1 if self._shot is None else self._shot.number + 1
        shot = Shot(number, left, disparity, known, trusted, confidence, limits,
                    is_matched=stamp_ns(message) in lefts)
        self._shot = shot
        self._own = {'confident pixels': f'{100 * float(trusted.mean()):.1f} %', **self._figures.of(shot, self._values)}

    def _take_diagnostics(self, message: DiagnosticArray) -> None:
        for status in message.status:
            if status.name != self._name:
                continue
            values = {value.key: value.value for value in status.values}
            stages = {key.removesuffix(' (ms)'): f'{value} ms' for key, value in values.items()
                      if key.endswith(' (ms)') and not key.startswith('latency')}
            self._diagnosed = {'time of a frame': stages.pop('total', ''), **stages}
            for key, name in _TOLD.items():
                if key in values:
                    self._diagnosed[name] = f'{values[key]} {key.partition("(")[2].rstrip(")")}'
            self._complaint = '' if status.level == DiagnosticStatus.OK else status.message


class _Holding:
    """Waits for one pair of the images that come to the node."""

    def __init__(self, node: Node, parameters: NodeParameters) -> None:
        self.frame: StereoFrame | None = None
        self.done = threading.Event()
        self._node = node
        self._topics = topics = ImageTopics.of(parameters)
        self._pairer: StereoPairer[Any] = StereoPairer(parameters.tolerance_ns)
        self._infos: dict[str, CameraInfo] = {}
        kind = CompressedImage if topics.transport == 'compressed' else Image
        self._subscriptions = [
            node.create_subscription(CameraInfo, f'{side}/camera_info', self._taker(side), sensor_qos())
            for side in SIDES]
        for side in SIDES[:1] if topics.together else SIDES:
            self._subscriptions.append(
                node.create_subscription(kind, topics.name(side), self._image_taker(side), sensor_qos()))

    def end(self) -> None:
        for subscription in self._subscriptions:
            self._node.destroy_subscription(subscription)

    def _taker(self, side: str) -> Callable[[CameraInfo], None]:
        def take(info: CameraInfo) -> None:
            self._infos[side] = info
        return take

    def _image_taker(self, side: Any) -> Callable[[Any], None]:
        def take(image: Any) -> None:
            if self._topics.together:
                self._finish(image, image)
            for pair in [] if self._topics.together else self._pairer.add(side, stamp_ns(image), image):
                self._finish(pair.left, pair.right)
        return take

    def _finish(self, left: Any, right: Any) -> None:
        """With the calibration, which is waited for; the last pair serves where none comes."""
        if self.done.is_set():
            return
        infos = self._infos.get('left'), self._infos.get('right')
        self.frame = StereoFrame(left, right, *infos, time.monotonic(), self._topics.input == 'raw')
        if None not in infos:
            self.done.set()
