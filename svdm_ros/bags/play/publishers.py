"""A ROS publisher for each topic of a recording: its type as it is installed, its QoS as it was offered."""
from __future__ import annotations

import importlib
from collections.abc import Iterable
from typing import Any

from rclpy.node import Node
from rclpy.publisher import Publisher
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from rosbags.interfaces import Qos, QosDurability, QosReliability
from rosbags.typesys import TypesysError
from rosbags.typesys.store import Typestore

from svdm_core.shown import cut

from ..reading.recording import Topic

_SMALLEST_DEPTH = 10
"""Messages a publisher keeps; what was recorded is what the camera kept, 0 or 1 as often as not."""
_LATCHED = ('/tf_static', '/robot_description')
"""Topics whose last message is for those who come later, where the recording does not say."""


class NotPlayable(ValueError):
    """A topic that cannot be published here; the text says why."""


def create_publishers(
    node: Node, topics: Iterable[Topic], types: Typestore
) -> tuple[dict[str, Publisher], list[NotPlayable]]:
    """Publishers by topic, and why topics are left out: a type that is not installed, or is another one here."""
    publishers: dict[str, Publisher] = {}
    left_out: list[NotPlayable] = []
    for topic in topics:
        try:
            publishers[topic.name] = _publisher(node, topic, types)
        except NotPlayable as reason:
            left_out.append(reason)
    return publishers, left_out


def _publisher(node: Node, topic: Topic, types: Typestore) -> Publisher:
    message_class = _installed(topic)
    publisher = node.create_publisher(message_class, topic.name, played_qos(topic))
    if not _is_same_type(node, publisher, topic, types):
        node.destroy_publisher(publisher)
        raise NotPlayable(f'{cut(topic.name)}: its {cut(topic.message_type)} was recorded with other fields than '
                          'the one installed has')
    return publisher


def _installed(topic: Topic) -> Any:
    package, _, name = topic.message_type.partition('/msg/')
    try:
        return getattr(importlib.import_module(f'{package}.msg'), name)
    except (ImportError, AttributeError):
        raise NotPlayable(f'{cut(topic.name)}: {cut(topic.message_type)} is not installed') from None


def _is_same_type(node: Node, publisher: Publisher, topic: Topic, types: Typestore) -> bool:
    """Bytes of another definition would reach subscribers as nonsense. True where the hash cannot be told."""
    try:
        recorded = types.hash_rihs01(topic.message_type)
    except (TypesysError, KeyError):
        return True
    infos = node.get_publishers_info_by_topic(publisher.topic_name)
    installed = [str(info.topic_type_hash) for info in infos if info.node_name == node.get_name()]
    return not installed or recorded in installed or not installed[0].startswith('RIHS01')


def played_qos(topic: Topic) -> QoSProfile:
    """What the recording's publishers offered. Where they differ or it is not known, RELIABLE and VOLATILE, which fits
    every subscription but latched ones.
    """
    durability = DurabilityPolicy.VOLATILE
    if _all(topic.qos, 'durability', QosDurability.TRANSIENT_LOCAL) or (not topic.qos and topic.name in _LATCHED):
        durability = DurabilityPolicy.TRANSIENT_LOCAL
    best_effort = _all(topic.qos, 'reliability', QosReliability.BEST_EFFORT)
    return QoSProfile(
        depth=max([_SMALLEST_DEPTH, *(profile.depth for profile in topic.qos)]), durability=durability,
        reliability=ReliabilityPolicy.BEST_EFFORT if best_effort else ReliabilityPolicy.RELIABLE)


def _all(profiles: Iterable[Qos], policy: str, value: object) -> bool:
    values = {getattr(profile, policy) for profile in profiles}
    return values == {value}
