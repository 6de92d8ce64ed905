"""`svdm warmup`: compiles the kernels ahead of the first frame. Must do without rich."""
from __future__ import annotations

import argparse
import time

from ..matcher import StereoMatcher
from ..presets import load_preset, preset_names


def add_arguments(_: argparse.ArgumentParser) -> None:
    """There are none."""


def run(_: argparse.Namespace) -> int:
    """Compile what the presets need, or load it from the cache; 0."""
    start = time.perf_counter()
    print('compiling the kernels of all presets: about a minute the first time, seconds once they are cached')
    for name in preset_names():
        StereoMatcher(load_preset(name)).warm_up()
    print(f'ready after {time.perf_counter() - start:.1f} s')
    return 0
