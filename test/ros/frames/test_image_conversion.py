"""sensor_msgs/Image to numpy: every encoding, row padding, byte order, and what is refused."""
import array

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as npst
from sensor_msgs.msg import Image

from svdm_ros.frames.image_conversion import ENCODINGS, image_to_array

SHAPES = st.tuples(st.integers(1, 7), st.integers(1, 7))
GREY8 = npst.arrays(np.uint8, SHAPES)
GREY16 = npst.arrays(np.uint16, SHAPES)
COLOUR = npst.arrays(np.uint8, SHAPES.map(lambda shape: (*shape, 3)))
PADDING = st.integers(0, 5)
BAYER = {  # the colour (index into B, G, R) of the upper left 2x2 pixels, as the name tells
    'bayer_rggb8': ((2, 1), (1, 0)),
    'bayer_bggr8': ((0, 1), (1, 2)),
    'bayer_gbrg8': ((1, 0), (2, 1)),
    'bayer_grbg8': ((1, 2), (0, 1)),
}


def image_message(stored, encoding, padding=0, big_endian=False):
    """`stored`: (H, W[, channels]) in the order and type of the encoding; padding bytes after each row are 0xEE."""
    rows = stored.astype(stored.dtype.newbyteorder('>' if big_endian else '<'))
    rows = np.ascontiguousarray(rows).view(np.uint8).reshape(stored.shape[0], -1)
    padded = np.pad(rows, ((0, 0), (0, padding)), constant_values=0xEE)
    return Image(
        height=stored.shape[0], width=stored.shape[1], encoding=encoding, step=padded.shape[1],
        is_bigendian=int(big_endian), data=array.array('B', padded.tobytes()),
    )


@pytest.mark.parametrize('encoding', ['mono8', '8UC1'])
@given(pixels=GREY8, padding=PADDING)
def test_grey_8_bit(encoding, pixels, padding):
    result = image_to_array(image_message(pixels, encoding, padding))
    assert result.dtype == np.uint8
    np.testing.assert_array_equal(result, pixels)


@pytest.mark.parametrize('encoding', ['mono16', '16UC1'])
@given(pixels=GREY16, padding=PADDING, big_endian=st.booleans())
def test_grey_16_bit_in_both_byte_orders(encoding, pixels, padding, big_endian):
    result = image_to_array(image_message(pixels, encoding, padding, big_endian))
    assert result.dtype == np.uint16
    assert result.dtype.isnative
    assert result.flags.aligned
    np.testing.assert_array_equal(result, pixels)


@pytest.mark.parametrize('encoding', ['bgr8', '8UC3', 'rgb8', 'bgra8', 'rgba8'])
@given(bgr=COLOUR, padding=PADDING)
def test_colour_comes_out_as_bgr(encoding, bgr, padding):
    stored = bgr[:, :, ::-1] if encoding.startswith('rgb') else bgr
    if encoding.endswith('a8'):
        stored = np.dstack([stored, np.full(bgr.shape[:2], 77, np.uint8)])
    result = image_to_array(image_message(stored, encoding, padding))
    assert result.dtype == np.uint8
    np.testing.assert_array_equal(result, bgr)


@pytest.mark.parametrize('encoding', sorted(BAYER))
@pytest.mark.parametrize('padding', [0, 3])
def test_a_mosaic_of_one_colour_is_that_colour(encoding, padding):
    bgr = np.array([10, 100, 200], np.uint8)
    mosaic = np.tile(bgr[np.array(BAYER[encoding])], (4, 5))
    result = image_to_array(image_message(mosaic, encoding, padding))
    assert result.shape == (8, 10, 3)
    np.testing.assert_array_equal(result, np.broadcast_to(bgr, (8, 10, 3)))


@pytest.mark.parametrize('encoding', sorted(BAYER))
def test_a_mosaic_of_a_smooth_scene_is_near_that_scene(encoding):
    rows, columns = np.mgrid[0:24, 0:32]
    scene = np.dstack([columns * 4, rows * 5, 200 - columns * 2 - rows]).astype(np.uint8)
    channel = np.tile(np.array(BAYER[encoding]), (12, 16))
    mosaic = np.take_along_axis(scene, channel[:, :, None], 2)[:, :, 0]
    result = image_to_array(image_message(mosaic, encoding))
    difference = cv2.absdiff(result, scene)[2:-2, 2:-2]
    assert difference.max() <= 2


@pytest.mark.parametrize('encoding', ['mono8', 'bgr8', 'rgb8', 'bgra8', 'rgba8', 'mono16'])
def test_the_pixels_are_not_copied(encoding):
    channels = {'bgr8': 3, 'rgb8': 3, 'bgra8': 4, 'rgba8': 4}.get(encoding, 1)
    stored = np.zeros((4, 6, channels), np.uint16 if encoding == 'mono16' else np.uint8)
    message = image_message(stored, encoding)
    assert np.shares_memory(image_to_array(message), np.frombuffer(message.data, np.uint8))


@pytest.mark.parametrize('encoding', ENCODINGS)
def test_an_image_one_byte_short_is_refused_with_both_lengths(encoding):
    message = image_message(np.zeros((4, 6, 8), np.uint8), encoding)
    message.data.pop()
    with pytest.raises(ValueError, match='the data has 191 bytes, 4 rows of 48 bytes make 192'):
        image_to_array(message)


@pytest.mark.parametrize('encoding', ENCODINGS)
def test_a_step_below_the_row_is_refused(encoding):
    message = image_message(np.zeros((4, 6), np.uint8), encoding)
    message.step = 5
    with pytest.raises(ValueError, match='step is 5 bytes, a row of 6 px'):
        image_to_array(message)


@pytest.mark.parametrize(('height', 'width'), [(0, 0), (0, 5), (5, 0)])
def test_an_empty_image_is_refused(height, width):
    with pytest.raises(ValueError, match=f'empty: {width}x{height} px'):
        image_to_array(Image(height=height, width=width, encoding='mono8', step=width))


@given(st.text(max_size=12).filter(lambda name: name not in ENCODINGS))
def test_an_unknown_encoding_is_named_with_the_ones_allowed(name):
    with pytest.raises(ValueError) as refusal:
        image_to_array(Image(height=1, width=1, encoding=name, step=1, data=[0]))
    assert repr(name) in str(refusal.value)
    assert 'mono8' in str(refusal.value)
    assert 'bayer_grbg8' in str(refusal.value)


def test_a_mosaic_too_small_to_interpolate_is_refused():
    with pytest.raises(ValueError, match='2x5 px is too small'):
        image_to_array(image_message(np.zeros((5, 2), np.uint8), 'bayer_rggb8'))
