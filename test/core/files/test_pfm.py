import numpy as np
import pytest
from scene_files import write_pfm
from scenes import noise

from svdm_core.files.pfm import encode_pfm, read_pfm


def test_what_is_written_is_read_again(tmp_path):
    image = noise(3, 4).astype(np.float32)
    image[0, 1] = np.inf
    path = tmp_path / 'a.pfm'
    path.write_bytes(encode_pfm(image))
    np.testing.assert_array_equal(read_pfm(path), image)
    assert path.read_bytes() == write_pfm(tmp_path / 'b.pfm', image).read_bytes()


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
