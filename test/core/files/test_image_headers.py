"""What image files declare is read as OpenCV reads it, and files that claim too many pixels are not decoded."""
import struct

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from svdm_core.files.image_headers import declared_size
from svdm_core.files.images import read_image

SUFFIXES = ('png', 'jpg', 'bmp', 'tiff', 'pgm', 'ppm', 'webp')


def encoded(suffix, width=37, height=5):
    shape = (height, width) if suffix == 'pgm' else (height, width, 3)
    return cv2.imencode(f'.{suffix}', np.full(shape, 7, np.uint8))[1].tobytes()


@pytest.mark.parametrize('suffix', SUFFIXES)
def test_the_declared_size_is_that_of_the_pixels(tmp_path, suffix):
    assert declared_size(encoded(suffix)) == (37, 5)
    path = tmp_path / f'a.{suffix}'
    path.write_bytes(encoded(suffix))
    assert read_image(path).shape == (5, 37, 3)


def test_other_forms_of_headers():
    assert declared_size(cv2.imencode('.webp', np.zeros((5, 37, 3), np.uint8), [cv2.IMWRITE_WEBP_QUALITY, 101])[1]
                         .tobytes()) == (37, 5)
    assert declared_size(cv2.imencode('.webp', np.zeros((5, 37, 4), np.uint8))[1].tobytes()) == (37, 5)
    assert declared_size(b'P5\n# by hand 1 2\n 37 # px\n5\n255\n') == (37, 5)
    assert declared_size(b'BM' + bytes(12) + struct.pack('<Iii', 40, 37, -5)) == (37, 5)
    assert declared_size(b'BM' + bytes(12) + struct.pack('<IHH', 12, 37, 5)) == (37, 5)
    assert declared_size(b'MM\x00*' + struct.pack('>IHHHIHHHHIHH', 8, 2, 256, 3, 1, 37, 0, 257, 3, 1, 5, 0)) == (37, 5)


def claims(suffix):
    """A small file of 16000x16000 px."""
    side = 16000
    if suffix == 'bmp':
        return b'BM' + bytes(12) + struct.pack('<IiiHHI', 40, side, side, 1, 8, 1) + bytes(500)
    if suffix == 'tiff':
        return b'II*\x00' + struct.pack('<IHHHIIHHII', 8, 2, 256, 4, 1, side, 257, 4, 1, side) + bytes(500)
    if suffix == 'pgm':
        return b'P2 16000 16000 255 ' + b'0 ' * 100
    data = bytearray(encoded(suffix))
    if suffix == 'png':
        data[16:24] = struct.pack('>II', side, side)
    else:
        at = data.index(b'\xff\xc0') + 5
        data[at:at + 4] = struct.pack('>HH', side, side)
    return bytes(data)


@pytest.mark.parametrize('suffix', ['png', 'jpg', 'bmp', 'tiff', 'pgm'])
def test_too_many_pixels_are_refused_before_memory_is_taken(tmp_path, suffix):
    path = tmp_path / f'a.{suffix}'
    path.write_bytes(claims(suffix))
    with pytest.raises(ValueError, match=rf'a\.{suffix}: the image declares 16000x16000 px, at most 64000000 px'):
        read_image(path)


def test_what_is_no_image_of_these_kinds_is_refused(tmp_path):
    path = tmp_path / 'a.png'
    path.write_bytes(b'GIF89a' + bytes(100))
    with pytest.raises(ValueError, match=r'a\.png: not an image of PNG, JPEG'):
        read_image(path)


@given(st.sampled_from(SUFFIXES), st.binary(max_size=60), st.integers(0, 60))
def test_any_bytes_have_a_size_or_none(suffix, noise, keep):
    size = declared_size(encoded(suffix)[:keep] + noise)
    assert size is None or all(isinstance(px, int) for px in size)
