"""Freed memory is kept: a stream of images larger than glibc's first thresholds asks the system for no page anew."""
import subprocess
import sys
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
FRAMES = '''
import resource
import numpy as np
from svdm_core import StereoMatcher, load_preset

matcher = StereoMatcher(load_preset("fast").replace(num_disparities=16), 1)
images = np.random.default_rng(1).integers(0, 256, (2, 400, 1300), np.uint8)
for _ in range(3):
    matcher.compute(*images)
before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
for _ in range(4):
    matcher.compute(*images)
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)'''


@pytest.mark.skipif(not sys.platform.startswith('linux'), reason='glibc only')
def test_further_frames_cause_hardly_a_page_fault():
    run = subprocess.run([sys.executable, '-c', FRAMES], cwd=CHECKOUT, capture_output=True, text=True, timeout=100)
    assert int(run.stdout) < 400, run.stderr  # without it more than 2000 a frame
