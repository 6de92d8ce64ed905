"""QoS of the node's topics, and what to say when somebody's does not fit."""
from __future__ import annotations

import contextlib
from collections.abc import Iterator

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions

OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
)


def sensor_qos() -> QoSProfile:
    """SensorDataQoS; a new one each time, as overriding changes it in place."""
    return _profile(5, ReliabilityPolicy.BEST_EFFORT)


def output_qos() -> QoSProfile:
    """Only the newest result, but that one surely."""
    return _profile(1, ReliabilityPolicy.RELIABLE)


def _profile(depth: int, reliability: ReliabilityPolicy) -> QoSProfile:
    return QoSProfile(
        history=HistoryPolicy.KEEP_LAST, depth=depth, reliability=reliability, durability=DurabilityPolicy.VOLATILE
    )


@contextlib.contextmanager
def naming_overrides(topic: str) -> Iterator[None]:
    """Around the making of a publisher or subscription: whatever a bad override raises becomes a ValueError."""
    try:
        yield
    except (AssertionError, TypeError, RuntimeError) as error:
        detail = str(error) or 'a value has the wrong type'
        raise ValueError(f'the parameters qos_overrides.{topic}.* make no QoS: {detail}') from error


def incompatible_line(topic: str, entity: str, policy: str) -> str:
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
