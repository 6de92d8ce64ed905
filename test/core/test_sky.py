"""Sky has no disparity that could be told: little of it may be trusted. On streets, where SVDM_DATA has them."""
import os
from pathlib import Path

import cv2
import numpy as np
import pytest

from svdm_core import StereoMatcher, load_preset
from svdm_core.evaluation.scene_evaluation import LEAST_CONFIDENCE

FRAMES = (10, 45)
SKY_ROWS = 160  # the horizon is below
OVEREXPOSED = 2.6  # times as bright, clipped at 255


def sky_of(grey):
    """bool (H, W): smooth, of middle brightness, and joined to the upper border. It was checked by eye."""
    slope = cv2.blur(np.abs(cv2.Sobel(grey, cv2.CV_32F, 1, 0, ksize=3)) / 8, (9, 7))
    smooth = (slope < 2.2) & (grey > 70) & (grey < 175)
    smooth[SKY_ROWS:] = False
    opened = cv2.morphologyEx(smooth.astype(np.uint8), cv2.MORPH_OPEN, np.ones((3, 3), np.uint8))
    _, labels, figures, _ = cv2.connectedComponentsWithStats(opened)
    upper = [label for label in np.unique(labels[:3]) if label and figures[label, cv2.CC_STAT_AREA] > 400]
    return np.isin(labels, upper)


@pytest.fixture(scope='module')
def street():
    folder = Path(os.environ.get('SVDM_DATA', 'unset')) / 'kitti_odometry_seq1'
    if not folder.is_dir():
        pytest.skip('SVDM_DATA names no folder with kitti_odometry_seq1')
    return [tuple(cv2.imread(str(folder / side / f'{frame:06d}.png'), cv2.IMREAD_GRAYSCALE)
                  for side in ('left', 'right')) for frame in FRAMES]


@pytest.mark.parametrize(('exposure', 'most'), [(1.0, 0.06), (OVEREXPOSED, 0.015)])  # measured 0.044 and 0.009
def test_the_sky_is_not_trusted_and_the_street_is(street, exposure, most):
    matcher = StereoMatcher(load_preset('default').replace(num_disparities=96))
    sky_pixels = trusted = checked = 0
    for left, right in street:
        exposed = [cv2.convertScaleAbs(image, alpha=exposure) for image in (left, right)]
        sky, result = sky_of(left), matcher.compute(*exposed)
        if exposure > 1:
            sky &= exposed[0] == 255
        sky_pixels += np.count_nonzero(sky)
        trusted += np.count_nonzero(result.confidence[sky] >= LEAST_CONFIDENCE)
        checked += np.count_nonzero(result.valid[sky])
        road = result.confidence[250:330, 450:800]  # lit and textured
        assert exposure > 1 or np.mean(road >= LEAST_CONFIDENCE) > 0.9
    assert sky_pixels > 100_000
    assert trusted <= most * sky_pixels
    assert trusted < checked / 3  # which the left-right check and the margin of each pixel alone would keep
