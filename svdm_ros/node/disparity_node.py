"""The disparity node: left and right image_rect and camera_info in, disparity, depth, points and more out."""
from __future__ import annotations

import time
from collections.abc import Callable
from functools import partial

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import QoSRequestedIncompatibleQoSInfo, SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import qos_policy_name_from_kind
from rclpy.subscription import Subscription
from sensor_msgs.msg import CompressedImage, Image

from ..calibration.rectification import unrectified_line
from ..frames.outputs import OUTPUTS
from ..frames.stereo_pairing import SideName
from ..frames.views import StereoFrame
from .camera_infos import CameraInfos, CameraInfoSubscriptions
from .declared_parameters import DeclaredParameters, unknown_parameter_line
from .diagnostics import diagnostic_array
from .failures import Failures
from .frame_statistics import FrameCounts, FrameStatistics, Rate
from .image_pairing import ImagePairing, stamp_ns
from .image_topics import SIDES, ImageTopics, all_image_topics, other_topics_hint
from .log_lines import Line, LogLines
from .matching import Matching
from .output_publishers import OutputPublishers
from .parameter_set import NodeParameters
from .quality_of_service import (
    OVERRIDABLE,
    Entity,
    check_overrides,
    incompatible_line,
    opening,
    override_names,
    sensor_qos,
)
from .shortfalls import Counts, FailedMatches, FallingBehind, LostImages
from .watchdog import Traffic, Watchdog

type AnyImage = Image | CompressedImage

_STATUS_PERIOD = 1.0
"""Seconds between two diagnostics, and between two looks of the watchdog."""


class DisparityNode(Node):
    """Wires the parts: callbacks pair the images, a worker thread matches and publishes, a timer watches.

    Images are subscribed to only while somebody listens to one of the outputs.
    Raises ValueError for a start-up parameter out of range.
    """

    def __init__(self) -> None:
        super().__init__('disparity_node', automatically_declare_parameters_from_overrides=True)
        self._statistics = FrameStatistics()
        self._log = LogLines(self.get_logger())
        self._dropped_before = 0
        self._infos = CameraInfos()
        self._pairing = ImagePairing(self._log)
        self._wired = False
        overrides = self._override_names()
        self._settings = DeclaredParameters(self, self._use_parameters, overrides)
        self._use_parameters(self._settings.current)
        for name in self._settings.unknown:
            self.get_logger().warning(unknown_parameter_line(name, overrides))
        check_overrides({name: self.get_parameter(name).value for name in overrides if self.has_parameter(name)})

        self._take_from(ImageTopics.of(self._settings.current))
        self._image_subscriptions: list[Subscription] = []
        self._outputs = OutputPublishers(self, self._report_incompatible, self._heed_listeners)
        self._outputs.adapt(self._settings.current)
        self._diagnostics = self.create_publisher(DiagnosticArray, '/diagnostics', 1)
        self.failures = Failures(self._statistics, self._log)
        self._matching = Matching(self._log, self._statistics, self._infos, self._outputs.publish,
                                  lambda: self._settings.current, self.context.ok)
        # The executor takes what has come in this order: calibration first, so that the first pair has it.
        self._info_subscriptions = CameraInfoSubscriptions(self, self._infos.take, self._subscribe)
        self._info_subscriptions.begin()
        self._wired = True
        self._subscribe_to_images()  # so that a setting that does not fit is told at the start
        self._heed_listeners()
        self._rate = Rate(time.monotonic())
        # Not the node's clock: with use_sim_time and no /clock it stands still, and silence is what is to be told.
        self.create_timer(_STATUS_PERIOD, self._watch, clock=Clock(clock_type=ClockType.STEADY_TIME))
        self._matching.start()

    def close(self) -> bool:
        """Stop the worker; False if it is still busy (compiling, or with a large image)."""
        return self._matching.stop(timeout=0.3)

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

    def _take_from(self, topics: ImageTopics) -> None:
        """From now on these are the topics of the images."""
        self._topics = topics
        names = {side: self._image_topic(side) for side in SIDES}
        self._pairing.begin(names, self._settings.current)
        self._lost = LostImages({'left': names['left']} if topics.together else names)
        self._behind, self._failed = FallingBehind(), FailedMatches()
        self._log.forget()

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

    def _leave_infos(self) -> None:
        """The last ones serve until there are newer ones; those that have not come yet are waited for."""
        for side in SIDES:
            if self._infos.latest(side) is not None:
                self._info_subscriptions.end(side)

    def _heed_listeners(self) -> None:
        """Take images while somebody listens, and none while nobody does."""
        if not self._outputs.have_listeners():
            self._leave_infos()
            self._leave_images()
            return
        self._info_subscriptions.begin()
        if not self._image_subscriptions:
            with self._log.complaining('topics'):
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
        self._pairing.use(parameters)
        topics = ImageTopics.of(parameters)
        if self._wired and topics != self._topics:
            self._leave_images()
            self._take_from(topics)
            with self._log.complaining('topics'):
                self._outputs.adapt(parameters)
            self._heed_listeners()

    # Callbacks of the executor's thread

    def _take_both(self, image: AnyImage) -> None:
        """An image that holds both views."""
        for side in SIDES:
            self._statistics.count_received(side)
        self._lost.add('left', stamp_ns(image))
        self._submit(image, image)

    def _take_image(self, side: SideName, image: AnyImage) -> None:
        self._statistics.count_received(side)
        self._lost.add(side, stamp_ns(image))
        for pair in self._pairing.add(side, image):
            self._submit(pair.left, pair.right)

    def _submit(self, left: AnyImage, right: AnyImage) -> None:
        self._statistics.count_pair()
        self._matching.submit(StereoFrame(left, right, None, None, time.monotonic(), raw=self._topics.input == 'raw'))

    def _watch(self) -> None:
        for reason, count in self._pairing.dropped.items():
            self._statistics.set_dropped(reason, count)
        counts = self._statistics.snapshot()
        self._heed_listeners()
        watching = self._image_subscriptions and self._matching.warm
        line = None if not watching else self._watchdog.check(time.monotonic(), Traffic(
            left=counts.received['left'],
            right=counts.received['right'],
            pairs=counts.pairs,
            left_publishers=self.count_publishers(self._image_topic('left')),
            right_publishers=self.count_publishers(self._image_topic('right')),
            closest_gap_ns=self._pairing.take_closest_gap(),
            tolerance_ns=self._pairing.tolerance_ns,
            hint=lambda: other_topics_hint(self._topics, self._types_on),
        ))
        rows = self._matching.rows.line(time.monotonic())
        if line is None and rows and self._image_subscriptions:
            line = Line('rows', rows)
        if line is not None:
            self._log.complain(line)
        self._look_at_infos()
        self._tell_shortfalls(counts, bool(watching))
        if counts.total_dropped > self._dropped_before:
            text = f'{counts.pairs} pairs, {counts.published} published; images and pairs: {counts.dropped_text()}'
            self._log.say(Line('counts', text))
        self._dropped_before = counts.total_dropped
        rate = self._rate.update(counts.published, time.monotonic())
        self._diagnostics.publish(diagnostic_array(
            self.get_fully_qualified_name(), self.get_clock().now().to_msg(), counts, rate,
            not self._matching.compiling, self._log.trouble, idle=not self._image_subscriptions,
            more=self._matching.rows.values(),
        ))

    def _tell_shortfalls(self, counts: FrameCounts, watching: bool) -> None:
        """What is lost, and what the node is too slow for; each is told when it begins and when it ends."""
        if not watching:
            return
        now, parameters = Counts.of(counts), self._settings.current
        counting = not self._matching.compiling and parameters.max_rate == 0
        for shortfall in (
            *self._lost.check(now, self._pairing.tolerance_ns),
            self._behind.check(now, counts.timings.get('total', 0.0), counting),
            self._failed.check([shares.valid for shares in counts.shares], parameters.matcher.tau_lr),
        ):
            self._log.last(shortfall.line, shortfall.over)

    def _types_on(self, name: str) -> set[str]:
        return {info.topic_type for info in self.get_publishers_info_by_topic(name)}

    def _look_at_infos(self) -> None:
        """Ask for those that are latched; tell where they have not come, or say that images are not rectified."""
        self._matching.tell_missing_infos()
        for side in SIDES:
            self._info_subscriptions.ask_for_latched(side)
            info = self._infos.latest(side)
            if info is not None and self._topics.input == 'rectified' and self._image_subscriptions:
                line = unrectified_line(info, self._image_topic(side))
                if line:
                    self._log.complain(Line(f'unrectified {side}', line))

    def _report_incompatible(self, topic: str, entity: Entity, event: QoSRequestedIncompatibleQoSInfo) -> None:
        policy = qos_policy_name_from_kind(event.last_policy_kind)
        line = Line(f'qos {topic} {policy}', incompatible_line(topic, entity, policy))
        self._log.alarm(line)
