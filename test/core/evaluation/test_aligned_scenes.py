"""Scenes are aligned by what they show, and it is remembered by what."""
import numpy as np
import row_scenes

from svdm_core import RowAlignment, estimate_row_alignment
from svdm_core.evaluation.aligned_scenes import SceneAligner, alignment_line
from svdm_core.evaluation.datasets import StereoScene


def scene(name, *coefficients):
    left, right = row_scenes.pair('leaves', RowAlignment(coefficients, row_scenes.WIDTH, row_scenes.HEIGHT))
    truth = np.full(left.shape, 9, np.float32)
    return StereoScene(name, left, right, truth, np.ones(left.shape, bool), 24)


def test_the_right_image_alone_is_resampled():
    off, aligned, aligner = scene('Attic', 0.5, 0, 0, 0.5, 0, 0), scene('Barn', 0, 0, 0, 0, 0, 0), SceneAligner()
    found = aligner.reader(lambda: off)()
    assert aligner.aligned(aligned) is aligned
    rows = estimate_row_alignment((off.left, off.right), 0, 24)
    np.testing.assert_array_equal(found.right, rows.apply(off.right))
    assert found.left is off.left and found.ground_truth is off.ground_truth
    assert aligner.found == {'Attic': rows, 'Barn': None}
    document = aligner.document()
    assert document == {'Attic': rows.as_dict(), 'Barn': None}
    assert alignment_line(document) == (
        f'rows aligned in 1 of 2 scenes (rms of the vertical offsets, px: Attic {rows.residual_before:.2f} to '
        f'{rows.residual_after:.2f}); as they are, nothing significant to correct, or too few points to tell: Barn')
