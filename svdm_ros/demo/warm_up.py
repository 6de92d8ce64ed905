"""Compiles the kernels of a preset beside the node, so that they are there when it is switched to that preset."""
from __future__ import annotations

import sys

import numpy as np

from svdm_core import StereoMatcher, load_preset

if __name__ == '__main__':
    StereoMatcher(load_preset(sys.argv[1])).warm_up([np.uint8])
