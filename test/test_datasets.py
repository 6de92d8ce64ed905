import cv2
import numpy as np
import pytest
from scenes import noise

from svdm_core.evaluation.datasets import middlebury_scenes, read_middlebury_scene
from svdm_core.files.pfm import read_pfm


def write_pfm(path, values, scale=-1.0, kind='Pf'):
    data = values[::-1].astype('<f4' if scale < 0 else '>f4').tobytes()
    path.write_bytes(f'{kind}\n{values.shape[1]} {values.shape[0]}\n{scale}\n'.encode() + data)
    return path


@pytest.mark.parametrize('scale', [-1.0, 1.0, -0.5])
def test_pfm_of_either_byte_order_comes_top_row_first(tmp_path, scale):
    values = np.arange(12, dtype=np.float32).reshape(3, 4)
    values[1, 2] = np.inf
    read = read_pfm(write_pfm(tmp_path / 'a.pfm', values, scale))
    np.testing.assert_array_equal(read, values)
    assert read.dtype == np.float32


def test_a_broken_pfm_is_named(tmp_path):
    path = write_pfm(tmp_path / 'a.pfm', np.zeros((3, 4)))
    path.write_bytes(path.read_bytes()[:-4])
    with pytest.raises(ValueError, match=r'a\.pfm: 44 bytes of data where 4 x 3 pixels take 48'):
        read_pfm(path)
    with pytest.raises(ValueError, match=r"kind 'PF'; one channel"):
        read_pfm(write_pfm(path, np.zeros((3, 4)), kind='PF'))
    path.write_text('nothing')
    with pytest.raises(ValueError, match='not a PFM file'):
        read_pfm(path)


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
    with pytest.raises(ValueError, match=r'im1\.png: missing, or not an image'):
        read_middlebury_scene(folder)
    folder = make_scene(tmp_path / 'Cellar')
    (folder / 'calib.txt').write_text('width=6\n')
    with pytest.raises(ValueError, match=r'calib\.txt: no line ndisp='):
        read_middlebury_scene(folder)
    with pytest.raises(ValueError, match='no scene in it'):
        middlebury_scenes(folder)
