"""QoS of the node's topics, and what to say when somebody's does not fit."""
from __future__ import annotations

import contextlib
from collections.abc import Collection, Iterator
from typing import Literal

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo

Entity = Literal['publisher', 'subscription']

OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
)


def sensor_qos() -> QoSProfile:
    """SensorDataQoS; a new one each time, as overriding changes it in place."""
    return _profile(5, ReliabilityPolicy.BEST_EFFORT)


def latched_qos() -> QoSProfile:
    """For what was sent before we came, and kept for us."""
    profile = _profile(1, ReliabilityPolicy.RELIABLE)
    profile.durability = DurabilityPolicy.TRANSIENT_LOCAL
    return profile


def is_latched(publisher: TopicEndpointInfo) -> bool:
    """Whether it keeps what it has sent for those who come later."""
    return bool(publisher.qos_profile.durability == DurabilityPolicy.TRANSIENT_LOCAL)


def output_qos() -> QoSProfile:
    """Only the newest result, but that one surely."""
    return _profile(1, ReliabilityPolicy.RELIABLE)


def _profile(depth: int, reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=DurabilityPolicy.VOLATILE
    )


def override_names(topic: str, entity: Entity) -> Iterator[str]:
    """The parameters that override the QoS of the node's own end of a topic, given by its full name."""
    for policy in OVERRIDABLE.policy_kinds:
        yield f'qos_overrides.{topic}.{entity}.{policy.name.lower()}'


@contextlib.contextmanager
def naming_overrides(topic: str, given: Collection[str]) -> Iterator[None]:
    """Around the making of a publisher or subscription: what a bad override raises, or the topic, becomes a ValueError.

    `given` are the names of the overrides set, of any topic.
    """
    try:
        yield
    except (AssertionError, TypeError, RuntimeError) as error:
        if any(name.startswith(f'qos_overrides.{topic}.') for name in given):
            detail = str(error) or 'a value has the wrong type'
            raise ValueError(f'the parameters qos_overrides.{topic}.* make no QoS: {detail}') from error
        raise ValueError(f'{topic} cannot be opened, is another topic remapped to it? {error}') from error


def incompatible_line(topic: str, entity: Entity, policy: str) -> str:
    """What to log of an incompatible-QoS event; `entity` is the node's own end, 'subscription' or 'publisher'."""
    other, loss = (
        ('publisher', 'nothing is received from it')
        if entity == 'subscription'
        else ('subscription', 'it receives nothing')
    )
    return (
        f'{topic}: a {other} has an incompatible QoS ({policy}) and {loss}: change it there, or start this node with '
        f'-p qos_overrides.{topic}.{entity}.{policy.lower()}:=...'
    )
