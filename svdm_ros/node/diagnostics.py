"""The counts as diagnostic_msgs/DiagnosticArray."""
from __future__ import annotations

import statistics
from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue

if TYPE_CHECKING:
    from builtin_interfaces.msg import Time

    from .frame_statistics import FrameCounts, PixelShares

_IDLE = 'idle: nobody subscribes to an output'

STATE, COMPILING, READY = 'state', 'compiling', 'ready'


def diagnostic_array(
    name: str, stamp: Time, counts: FrameCounts, rate: float, ready: bool, trouble: str = '',
    idle: bool = False, more: Mapping[str, str] = MappingProxyType({}),
) -> DiagnosticArray:
    """One status: OK, or WARN with `trouble`; values are totals, Hz and ms, and the `state`: COMPILING or READY.

    The state is for whoever waits for the node: what the message tells is for people, and a trouble comes first in it.
    idle: no images are taken, as nobody listens. more: further values.
    Latency is from arrival to publication; the stages are means over the frames since the last diagnostics.
    """
    status = DiagnosticStatus(name=name, hardware_id='')
    status.level = DiagnosticStatus.WARN if trouble or not ready else DiagnosticStatus.OK
    status.message = trouble or (COMPILING if not ready else _IDLE if idle else f'{rate:.1f} Hz')
    values = {
        STATE: READY if ready else COMPILING,
        'left images': str(counts.received['left']),
        'right images': str(counts.received['right']),
        'pairs': str(counts.pairs),
        'published': str(counts.published),
        'defects': str(counts.defects),
        'rate (Hz)': f'{rate:.2f}',
        **_shares(counts.shares),
        **more,
        **_latencies(counts.latencies),
        **{f'{stage} (ms)': f'{milliseconds:.1f}' for stage, milliseconds in counts.timings.items()},
        **{f'dropped: {reason}': str(count) for reason, count in counts.dropped.items()},
    }
    status.values = [KeyValue(key=key, value=value) for key, value in values.items()]
    message = DiagnosticArray(status=[status])
    message.header.stamp = stamp
    return message


def _shares(shares: tuple[PixelShares, ...]) -> dict[str, str]:
    if not shares:
        return {}
    valid, confident = (statistics.fmean(values) for values in zip(*shares, strict=True))
    return {'valid pixels (%)': f'{100 * valid:.0f}',
            'confidence above confidence_threshold (%)': f'{100 * confident:.0f}'}


def _latencies(latencies: tuple[float, ...]) -> dict[str, str]:
    if not latencies:
        return {}
    ordered = sorted(latencies)
    return {
        'latency p50 (ms)': f'{ordered[len(ordered) // 2] * 1e3:.1f}',
        'latency p95 (ms)': f'{ordered[min(len(ordered) - 1, len(ordered) * 95 // 100)] * 1e3:.1f}',
    }
