"""`svdm warmup`: compiles the kernels ahead of the first frame. Must do without rich."""
from __future__ import annotations

import argparse
import time

from ..matcher import StereoMatcher


def add_arguments(_: argparse.ArgumentParser) -> None:
    """There are none."""


def run(_: argparse.Namespace) -> int:
    """Compile, or load from the cache; 0."""
    start = time.perf_counter()
    print('compiling the kernels, up to a minute the first time')
    StereoMatcher().warm_up()
    print(f'ready after {time.perf_counter() - start:.1f} s')
    return 0
