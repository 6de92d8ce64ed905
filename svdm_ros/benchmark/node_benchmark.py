"""The command of the node's benchmark: its arguments, what it prints and writes."""
from __future__ import annotations

import argparse
import json
import sys
from pathlib import Path
from typing import Any

from svdm_core.benchmark.limits import check_memory
from svdm_core.commands.argument_types import positive, size
from svdm_core.files.output_files import check_outputs, write_outputs
from svdm_core.presets import load_preset, preset_names

from ..node.end_signals import EndSignals
from ..processes.children import RunError
from .measurement import measure


def run(signals: EndSignals, arguments: list[str] | None) -> int:
    """The exit code, as `main` of the package has it."""
    options = _parse(arguments)

    def check() -> None:
        if signals.received:
            raise KeyboardInterrupt

    outputs = [options.json] if options.json is not None else []
    try:
        check_outputs(outputs, options.force)
        width, height = options.size
        check_memory(width, height, load_preset(options.preset).num_disparities)
        signals.end_in_order()  # from here on there are children to be ended first
        settings = {'size': list(options.size), 'preset': options.preset, 'rate': options.rate,
                    'seconds': options.seconds}
        figures = measure(options.size, options.rate, options.seconds, options.preset, check)
        print(_line(settings, figures))
        text = json.dumps({**settings, **figures}, indent=1) + '\n'
        write_outputs({path: text.encode() for path in outputs}, options.force)
    except KeyboardInterrupt:
        return signals.code
    except (RunError, ValueError) as error:
        print(f'node_benchmark: {error}', file=sys.stderr)
        return 1 if isinstance(error, RunError) else 2
    return 0


def _parse(arguments: list[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='node_benchmark', description='Measure the node at a given size and rate.')
    parser.add_argument('--size', type=size, default=(640, 480), metavar='WxH', help='image size, px (640x480)')
    parser.add_argument('--rate', type=positive, default=30.0, metavar='HZ', help='pairs sent a second (30)')
    parser.add_argument('--seconds', type=positive, default=15.0, metavar='S', help='how long to count (15)')
    parser.add_argument('--preset', choices=preset_names(), default='fast', help='preset of the node (fast)')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write the figures')
    parser.add_argument('--force', action='store_true', help='overwrite a file that exists')
    return parser.parse_args(arguments)


def _line(settings: dict[str, Any], figures: dict[str, Any]) -> str:
    width, height = settings['size']
    latency, matcher = figures['latency_ms'], figures['matcher_ms']
    first = figures['first_output_s']
    took = f'; the matcher took {matcher:.1f} ms of the mean' if matcher is not None else ''
    return (f'{width}x{height} grey, preset {settings["preset"]}: {figures["in_hz"]:.1f} Hz in, '
            f'{figures["out_hz"]:.1f} Hz out; from stamp to receipt mean {latency["mean"]:.1f}, '
            f'p50 {latency["p50"]:.1f}, p90 {latency["p90"]:.1f}, p99 {latency["p99"]:.1f} ms{took}; a new '
            f'listener has its first image after {min(first):.2f} to {max(first):.2f} s')
