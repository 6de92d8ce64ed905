import cv2
import numpy as np
import pytest
from scene_files import write_pfm
from scenes import noise

from svdm_core.evaluation.datasets import middlebury_scenes, read_middlebury_scene


def make_scene(folder):
    folder.mkdir()
    for name in ('im0', 'im1'):
        cv2.imwrite(str(folder / f'{name}.png'), noise(5, 6, 3))
    cv2.imwrite(str(folder / 'mask0nocc.png'), np.array([[255, 128, 0, 255, 255, 0]] * 5, np.uint8))
    write_pfm(folder / 'disp0.pfm', np.full((5, 6), 3.0))
    (folder / 'calib.txt').write_text('doffs=0\nndisp=70\nvmin=7\n')
    return folder


def test_a_scene_is_read_whole(tmp_path):
    scene = read_middlebury_scene(make_scene(tmp_path / 'Attic'))
    assert (scene.name, scene.num_disparities, scene.left.shape) == ('Attic', 70, (5, 6, 3))
    assert scene.nonocc[0].tolist() == [True, False, False, True, True, False]
    assert (scene.ground_truth == 3).all()
    assert [path.name for path in middlebury_scenes(tmp_path)] == ['Attic']


def test_what_is_missing_in_a_scene_is_named(tmp_path):
    folder = make_scene(tmp_path / 'Attic')
    (folder / 'im1.png').unlink()
    with pytest.raises(ValueError, match=r'im1\.png: there is no such file'):
        read_middlebury_scene(folder)
    folder = make_scene(tmp_path / 'Cellar')
    (folder / 'calib.txt').write_text('width=6\n')
    with pytest.raises(ValueError, match=r'calib\.txt: no line ndisp='):
        read_middlebury_scene(folder)
    with pytest.raises(ValueError, match='no scene in it'):
        middlebury_scenes(folder)
