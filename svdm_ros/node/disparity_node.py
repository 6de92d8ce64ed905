"""The disparity node: left and right image_rect and camera_info in, disparity, depth, points and more out."""
from __future__ import annotations

import contextlib
import time
import traceback
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind
from rclpy.subscription import Subscription
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from svdm_core import NotEnoughMemoryError

from ..calibration.rectification import unrectified_line
from ..frames.frame_processing import FrameProcessor
from ..frames.outputs import OUTPUTS
from ..frames.row_offsets import RectificationCheck
from ..frames.stereo_pairing import SideName, StereoPairer
from ..frames.views import FrameError, StereoFrame
from .declared_parameters import DeclaredParameters, unknown_parameter_line
from .diagnostics import diagnostic_array
from .frame_statistics import FrameStatistics, Rate
from .image_topics import SIDES, ImageTopics, all_image_topics, other_topics_hint
from .output_publishers import OutputPublishers
from .parameter_set import NodeParameters
from .quality_of_service import (
    OVERRIDABLE,
    Entity,
    check_overrides,
    incompatible_line,
    is_latched,
    latched_qos,
    opening,
    override_names,
    sensor_qos,
)
from .watchdog import Line, Throttle, Traffic, Watchdog
from .worker import Worker

type AnyImage = Image | CompressedImage

_STATUS_PERIOD = 1.0
"""Seconds between two diagnostics, and between two looks of the watchdog."""
_TROUBLE_LASTS = 3.0
"""Seconds for which diagnostics tell of a trouble after it was last met."""


class DisparityNode(Node):
    """Wires the parts: callbacks pair the images, a worker thread matches and publishes, a timer watches.

    Images are subscribed to only while somebody listens to one of the outputs.
    Raises ValueError for a start-up parameter out of range.
    """

    def __init__(self) -> None:
        super().__init__('disparity_node', automatically_declare_parameters_from_overrides=True)
        self._statistics = FrameStatistics()
        self._throttle = Throttle()
        self._trouble: tuple[float, str] = (-_TROUBLE_LASTS, '')
        self._dropped_before = 0
        self._infos: dict[SideName, CameraInfo | None] = dict.fromkeys(SIDES)
        self._pairer: StereoPairer[AnyImage] = StereoPairer()
        self._wired = False
        self._compiling = self._hint = ''
        self._unpaired_before: Counter[SideName] = Counter()
        overrides = self._override_names()
        self._settings = DeclaredParameters(self, self._use_parameters, overrides)
        self._use_parameters(self._settings.current)
        for name in self._settings.unknown:
            self.get_logger().warning(unknown_parameter_line(name, overrides))
        check_overrides({name: self.get_parameter(name).value for name in overrides if self.has_parameter(name)})

        self._topics = ImageTopics.of(self._settings.current)
        self._image_subscriptions: list[Subscription] = []
        self._outputs = OutputPublishers(self, self._report_incompatible, self._heed_listeners)
        self._outputs.adapt(self._settings.current)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 1)
        self._rectification = RectificationCheck()
        self._processor = FrameProcessor(self._report_compiling, self._rectification)
        self._worker: Worker[StereoFrame] = Worker(
            self._warm_up, self._process, self._statistics.count_drop, self._report_failure,
            lambda: self._settings.current.period
        )
        # The executor takes what has come in this order: calibration first, so that the first pair has it.
        self._info_subscriptions: dict[SideName, Subscription] = {}
        self._subscribe_to_infos()
        self._latched_infos: set[SideName] = set()
        self._wired = True
        self._subscribe_to_images()  # so that a setting that does not fit is told at the start
        self._heed_listeners()
        self._rate = Rate(time.monotonic())
        # Not the node's clock: with use_sim_time and no /clock it stands still, and silence is what is to be told.
        self.create_timer(_STATUS_PERIOD, self._watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._worker.start()

    def close(self) -> bool:
        """Stop the worker; False if it is still busy (compiling, or with a large image)."""
        return self._worker.stop(timeout=0.3)

    def report_defect(self, what: str, error: Exception) -> None:
        """Count and log an exception that nothing accounts for, with its traceback. From any thread."""
        self._statistics.count_defect()
        details = ''.join(traceback.format_exception(error))
        self._complain(Line(what, f'{what} by a defect of this node, please report it: {details}'))

    # Set-up

    def _override_names(self) -> list[str]:
        """The names of all parameters that override the QoS of a topic."""
        names: list[str] = []
        for output in OUTPUTS:
            names += override_names(self.resolve_topic_name(output.topic), 'publisher')
        images = dict.fromkeys(topics.name(side) for topics in all_image_topics() for side in SIDES)
        for topic in (*(f'{side}/camera_info' for side in SIDES), *images):
            names += override_names(self.resolve_topic_name(topic), 'subscription')
        return names

    def _ask_for_latched_info(self, side: SideName) -> None:
        """What was latched before this node came reaches only who asks for it, and who asks gets nothing else."""
        name = f'{side}/camera_info'
        publishers = self.get_publishers_info_by_topic(name)
        if side not in self._latched_infos and any(map(is_latched, publishers)):
            self._latched_infos.add(side)
            self.create_subscription(CameraInfo, name, partial(self._take_info, side), latched_qos(),
                                     event_callbacks=SubscriptionEventCallbacks(use_default_callbacks=False))

    def _image_topic(self, side: SideName) -> str:
        return self.resolve_topic_name(self._topics.name(side))

    def _subscribe_to_images(self) -> None:
        self._watchdog = Watchdog(self._image_topic('left'), self._image_topic('right'), time.monotonic(),
                                  names=(self._topics.name('left'), self._topics.name('right')))
        kind = CompressedImage if self._topics.transport == 'compressed' else Image
        takers: dict[str, Callable[[AnyImage], None]] = {
            self._topics.name(side): partial(self._take_image, side) for side in SIDES}
        if self._topics.together:
            takers = {self._topics.name('left'): self._take_both}
        try:
            for name, take in takers.items():
                self._image_subscriptions.append(self._subscribe(kind, name, take))
        except ValueError:
            self._leave_images()
            raise

    def _leave_images(self) -> None:
        for subscription in self._image_subscriptions:
            self.destroy_subscription(subscription)
        self._image_subscriptions = []

    def _subscribe_to_infos(self) -> None:
        for side in SIDES:
            if side not in self._info_subscriptions:
                self._info_subscriptions[side] = self._subscribe(
                    CameraInfo, f'{side}/camera_info', partial(self._take_info, side))

    def _leave_infos(self) -> None:
        """The last ones serve until there are newer ones; those that have not come yet are waited for."""
        for side in SIDES:
            if self._infos[side] is not None and side in self._info_subscriptions:
                self.destroy_subscription(self._info_subscriptions.pop(side))

    def _heed_listeners(self) -> None:
        """Take images while somebody listens, and none while nobody does."""
        if not self._outputs.have_listeners():
            self._leave_infos()
            self._leave_images()
            return
        self._subscribe_to_infos()
        if not self._image_subscriptions:
            with self._complaining('topics'):
                self._subscribe_to_images()

    def _subscribe[Message](
        self, message_type: type[Message], name: str, take: Callable[[Message], None]
    ) -> Subscription:
        topic = self.resolve_topic_name(name)
        with opening(topic):
            return self.create_subscription(
                message_type, name, take, sensor_qos(), qos_overriding_options=OVERRIDABLE,
                event_callbacks=SubscriptionEventCallbacks(
                    incompatible_qos=lambda event: self._report_incompatible(topic, 'subscription', event)),
            )

    def _use_parameters(self, parameters: NodeParameters) -> None:
        """The pairing's part; the worker looks at `current` before each frame."""
        self._pairer.tolerance_ns = parameters.tolerance_ns
        self._pairer.queue_size = parameters.queue_size
        topics = ImageTopics.of(parameters)
        if self._wired and topics != self._topics:
            self._leave_images()
            self._unpaired_before.update(self._pairer.unpaired)
            self._topics, self._pairer = topics, StereoPairer(parameters.tolerance_ns, parameters.queue_size)
            with self._complaining('topics'):
                self._outputs.adapt(parameters)
            self._heed_listeners()

    # Callbacks of the executor's thread

    def _take_info(self, side: SideName, info: CameraInfo) -> None:
        self._infos[side] = info

    def _take_both(self, image: AnyImage) -> None:
        """An image that holds both views."""
        for side in SIDES:
            self._statistics.count_received(side)
        self._submit(image, image)

    def _take_image(self, side: SideName, image: AnyImage) -> None:
        self._statistics.count_received(side)
        stamp = image.header.stamp.sec * 1_000_000_000 + image.header.stamp.nanosec
        jumps = self._pairer.jumps
        pairs = self._pairer.add(side, stamp, image)
        if self._pairer.jumps != jumps:
            self._say(Line('jump', f'the stamps of {self._image_topic(side)} jumped back (a looping bag?): going on'))
        for pair in pairs:
            self._submit(pair.left, pair.right)

    def _submit(self, left: AnyImage, right: AnyImage) -> None:
        self._statistics.count_pair()
        self._worker.submit(StereoFrame(left, right, self._infos['left'], self._infos['right'], time.monotonic(),
                                        raw=self._topics.input == 'raw'))

    def _watch(self) -> None:
        for side, count in self._pairer.unpaired.items():
            self._statistics.set_dropped(f'unpaired {side}', count + self._unpaired_before[side])
        counts = self._statistics.snapshot()
        self._heed_listeners()
        watching = self._image_subscriptions and self._worker.ready
        line = None if not watching else self._watchdog.check(time.monotonic(), Traffic(
            left=counts.received['left'],
            right=counts.received['right'],
            pairs=counts.pairs,
            left_publishers=self.count_publishers(self._image_topic('left')),
            right_publishers=self.count_publishers(self._image_topic('right')),
            closest_gap_ns=self._pairer.take_closest_gap(),
            tolerance_ns=self._pairer.tolerance_ns,
            hint=lambda: other_topics_hint(self._topics, self._types_on),
        ))
        rows = self._rectification.line(time.monotonic())
        if line is None and rows and self._image_subscriptions:
            line = Line('rows', rows)
        if line is not None:
            self._complain(line)
        self._look_at_infos()
        if counts.total_dropped > self._dropped_before:
            text = f'{counts.pairs} pairs, {counts.published} published; images and pairs: {counts.dropped_text()}'
            self._say(Line('counts', text))
        self._dropped_before = counts.total_dropped
        rate = self._rate.update(counts.published, time.monotonic())
        since, trouble = self._trouble
        self._diagnostics.publish(diagnostic_array(
            self.get_fully_qualified_name(), self.get_clock().now().to_msg(), counts, rate,
            self._worker.ready and not self._compiling,
            trouble if time.monotonic() - since < _TROUBLE_LASTS else '', idle=not self._image_subscriptions,
            more=self._rectification.values(),
        ))

    def _types_on(self, name: str) -> set[str]:
        return {info.topic_type for info in self.get_publishers_info_by_topic(name)}

    def _look_at_infos(self) -> None:
        """Ask for those that are latched; tell where they say that images are not rectified."""
        for side in SIDES:
            self._ask_for_latched_info(side)
            info = self._infos[side]
            if info is not None and self._topics.input == 'rectified' and self._image_subscriptions:
                line = unrectified_line(info, self._image_topic(side))
                if line:
                    self._complain(Line(f'unrectified {side}', line))

    # The worker's thread

    def _warm_up(self) -> None:
        self.get_logger().info('compiling the kernels, up to a minute the first time')
        start = time.monotonic()
        self._processor.warm_up(self._settings.current)
        if self.context.ok():  # else the process is ending, and a line could not be published
            self.get_logger().info(f'ready: kernels compiled or loaded in {time.monotonic() - start:.1f} s')

    def _process(self, frame: StereoFrame) -> None:
        try:
            done = self._processor.process(frame, self._settings.current)
        except FrameError as error:
            self._statistics.count_drop(error.reason)
            self._complain(Line(error.reason, str(error)))
            return
        except NotEnoughMemoryError as error:
            self._statistics.count_drop('no memory')
            self._complain(Line('no memory', f'pair dropped: {error}'))
            return
        finally:
            self._say_compiled()
        self._outputs.publish(done.frame)
        self._statistics.count_published(time.monotonic() - frame.arrived, done.timings)
        if done.hint != self._hint:  # said once: it is no fault
            self._hint = done.hint
            if done.hint:
                self.get_logger().info(done.hint)
        if done.problem:
            geometry = done.frame.geometry
            known = f'f = {geometry.focal_length:g}, t = {geometry.baseline:g}'
            self._complain(Line('published', f'disparity published with {known}: {done.problem}'))

    def _report_compiling(self, what: str) -> None:
        self._compiling = what
        text = f'new parameters or images: compiling the kernels for {what}, nothing comes out for up to a minute'
        self._say(Line(f'compiling {what}', text))

    def _say_compiled(self) -> None:
        if self._compiling:
            self._say(Line(f'compiled {self._compiling}', f'ready: kernels compiled or loaded for {self._compiling}'))
            self._compiling = ''

    def _report_failure(self, error: Exception) -> None:
        if not self.context.ok():
            return  # the end of the process, seen from the worker
        if self._worker.ready:
            self._statistics.count_drop('failed')
            self.report_defect('frame dropped', error)
        else:
            self.report_defect('warm-up cut short, the first pairs take longer', error)

    # Log lines, from any thread

    @contextlib.contextmanager
    def _complaining(self, kind: str) -> Iterator[None]:
        """A ValueError becomes a line, and the node goes on."""
        try:
            yield
        except ValueError as error:
            self._complain(Line(kind, str(error)))

    def _complain(self, line: Line) -> None:
        self._trouble = (time.monotonic(), line.text)
        text = self._throttle.admit(line, time.monotonic())
        if text is not None:
            self.get_logger().warning(text)

    def _say(self, line: Line) -> None:
        text = self._throttle.admit(line, time.monotonic())
        if text is not None:
            self.get_logger().info(text)

    def _report_incompatible(self, topic: str, entity: Entity, event: QoSRequestedIncompatibleQoSInfo) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        line = Line(f'qos {topic} {policy}', incompatible_line(topic, entity, policy))
        text = self._throttle.admit(line, time.monotonic())
        if text is not None:
            self.get_logger().error(text)
