"""QoS of the node's topics, and what to say when somebody's does not fit."""
from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from typing import Literal

from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSPolicyKind, QoSProfile, ReliabilityPolicy
from rclpy.qos_overriding_options import QoSOverridingOptions
from rclpy.topic_endpoint_info import TopicEndpointInfo

from svdm_core.shown import shown

Entity = Literal['publisher', 'subscription']

OVERRIDABLE = QoSOverridingOptions(
    (QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY, QoSPolicyKind.DURABILITY)
)
_POLICIES = {'history': HistoryPolicy, 'reliability': ReliabilityPolicy, 'durability': DurabilityPolicy}
_LARGEST_DEPTH = 2**31 - 1


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


def check_overrides(given: Mapping[str, object]) -> None:
    """Raise ValueError, in one line, where a value makes no QoS: of any topic, whether it is in use or not.

    given: by the names that `override_names` has.
    """
    problems = [f'{name} = {shown(value)} is not allowed: it must be {allowed}' for name, value in given.items()
                if (allowed := _allowed(name.rpartition('.')[2], value))]
    if problems:
        raise ValueError('; '.join(problems))


def _allowed(policy: str, value: object) -> str:
    """What a value of a policy must be; empty where it is that."""
    if policy == 'depth':
        is_depth = isinstance(value, int) and not isinstance(value, bool) and 0 <= value <= _LARGEST_DEPTH
        return '' if is_depth else f'an integer, 0 to {_LARGEST_DEPTH}'
    names = [name.lower() for name in _POLICIES[policy].__members__ if name.isupper() and name != 'UNKNOWN']
    return '' if isinstance(value, str) and value.lower() in names else ' | '.join(names)


@contextlib.contextmanager
def opening(topic: str) -> Iterator[None]:
    """Around the making of a publisher or subscription: what rclpy raises where there can be none is a ValueError."""
    try:
        yield
    except RuntimeError as error:
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
