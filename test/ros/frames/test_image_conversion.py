"""sensor_msgs/Image to numpy: every encoding, row padding, byte order, and what is refused."""
import array

import cv2
import numpy as np
import pytest
from encoded_images import PLANAR, as_stored
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


@pytest.mark.parametrize('encoding', ['bgr8', '8UC3', 'rgb8', 'bgra8', '8UC4', 'rgba8'])
@given(bgr=COLOUR, padding=PADDING)
def test_colour_comes_out_as_bgr(encoding, bgr, padding):
    stored = bgr[:, :, ::-1] if encoding.startswith('rgb') else bgr
    if encoding in ('bgra8', 'rgba8', '8UC4'):
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


@pytest.mark.parametrize('encoding', ['mono8', 'bgr8', 'rgb8', 'bgra8', 'rgba8', '8UC4', 'mono16', 'rgb16', 'bgra16'])
def test_the_pixels_are_not_copied(encoding):
    message = image_message(as_stored(np.zeros((4, 6), np.uint8), encoding), encoding)
    assert np.shares_memory(image_to_array(message), np.frombuffer(message.data, np.uint8))


@pytest.mark.parametrize('encoding', ENCODINGS)
def test_an_image_one_byte_short_is_refused_with_both_lengths(encoding):
    rows, told = (6, '4 rows and 2 of chroma') if encoding in PLANAR else (4, '4 rows')
    message = image_message(np.zeros((rows, 6, 8), np.uint8), encoding)
    message.height = 4
    message.data.pop()
    with pytest.raises(ValueError, match=f'the data has {48 * rows - 1} bytes, {told} of 48 bytes make {48 * rows}'):
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


@pytest.mark.parametrize('encoding', ['bayer_rggb8', 'bayer_rggb16'])
def test_a_mosaic_too_small_to_interpolate_is_refused(encoding):
    with pytest.raises(ValueError, match='2x5 px is too small'):
        image_to_array(image_message(as_stored(np.zeros((5, 2), np.uint8), encoding), encoding))


@pytest.mark.parametrize('encoding', ['nv24', 'bayer_rggb12', '64FC1', 'RGB8'])
def test_what_sensor_msgs_has_and_this_has_not_is_refused_by_name(encoding):
    with pytest.raises(ValueError, match=f"encoding '{encoding}' is not supported: use one of mono8, ") as refusal:
        image_to_array(image_message(np.zeros((4, 4), np.float64), encoding))
    assert str(refusal.value).isprintable()


def test_a_long_name_of_an_encoding_is_cut():
    with pytest.raises(ValueError) as refusal:
        image_to_array(Image(height=1, width=1, encoding='x\n' * 9999, step=1, data=[0]))
    assert str(refusal.value).isprintable() and len(str(refusal.value)) < 1000


# More than 8 bits


COLOUR16 = npst.arrays(np.uint16, SHAPES.map(lambda shape: (*shape, 3)))


@pytest.mark.parametrize('encoding', ['bgr16', 'rgb16', 'bgra16', 'rgba16'])
@given(bgr=COLOUR16, padding=PADDING, big_endian=st.booleans())
def test_colour_of_16_bits_comes_out_as_bgr(encoding, bgr, padding, big_endian):
    channels = bgr[:, :, ::-1] if encoding.startswith('rgb') else bgr
    if 'a' in encoding:
        channels = np.dstack([channels, np.full(bgr.shape[:2], 777, np.uint16)])
    result = image_to_array(image_message(channels, encoding, padding, big_endian))
    assert result.dtype == np.uint16 and result.dtype.isnative and result.flags.aligned
    np.testing.assert_array_equal(result, bgr)


@pytest.mark.parametrize('encoding', sorted(BAYER))
@given(pixels=npst.arrays(np.uint8, st.tuples(st.integers(3, 7), st.integers(3, 7))), padding=PADDING,
       big_endian=st.booleans())
def test_a_mosaic_of_16_bits_is_that_of_8_bits(encoding, pixels, padding, big_endian):
    expected = image_to_array(image_message(pixels, encoding)).astype(int)
    message = image_message(pixels.astype(np.uint16) * 256, encoding.replace('8', '16'), padding, big_endian)
    result = image_to_array(message)
    assert result.dtype == np.uint16
    assert np.abs(result / 256 - expected).max() <= 0.5


@given(pixels=npst.arrays(np.float32, SHAPES, elements=st.floats(0, 1, width=32)), padding=PADDING,
       big_endian=st.booleans())
def test_floats_of_0_to_1_become_0_to_65535(pixels, padding, big_endian):
    result = image_to_array(image_message(pixels, '32FC1', padding, big_endian))
    assert result.dtype == np.uint16
    assert np.abs(result - pixels.astype(float) * 65535).max() <= 0.5 + 1e-2
    assert np.array_equal(result[pixels == 1], np.full((pixels == 1).sum(), 65535))


@pytest.mark.parametrize(('value', 'told'), [
    (np.nan, 'nan'), (np.inf, 'inf'), (-0.001, '-0.001'), (1.001, '1.001'), (255.0, '255')])
def test_floats_that_are_no_grey_are_refused_with_their_place(value, told):
    pixels = np.full((3, 5), 0.5, np.float32)
    pixels[1, 4] = value
    with pytest.raises(ValueError, match=rf'32FC1 holds {told} at \(4, 1\), grey must be 0 to 1'):
        image_to_array(image_message(pixels, '32FC1', padding=3))


# YUV


def bgr_of(y, u, v):
    """BT.601 with luma 16 to 235 and chroma around 128, from its equations; (H, W, 3) float."""
    luma, blue, red = 255 / 219 * (np.maximum(y, 16.0) - 16), u - 128.0, v - 128.0
    return np.clip(np.dstack([
        luma + 2 * (1 - 0.114) * 255 / 224 * blue,
        luma - (2 * (1 - 0.114) * 0.114 * blue + 2 * (1 - 0.299) * 0.299 * red) * 255 / 224 / 0.587,
        luma + 2 * (1 - 0.299) * 255 / 224 * red]), 0, 255)


EVEN = st.tuples(st.integers(1, 5), st.integers(1, 5)).map(lambda shape: (2 * shape[0], 2 * shape[1]))


@pytest.mark.parametrize('encoding', ['uyvy', 'yuv422', 'yuyv', 'yuv422_yuy2'])
@given(y=npst.arrays(np.uint8, EVEN), seed=st.integers(0, 99), padding=PADDING, odd=st.booleans())
def test_yuv_of_two_bytes_a_pixel_follows_the_equations(encoding, y, seed, padding, odd):
    y = y[1:] if odd else y  # an odd height does no harm
    chroma = np.random.default_rng(seed).integers(0, 256, y.shape, np.uint8)  # u, v, u, v ...
    order = [chroma, y] if encoding in ('uyvy', 'yuv422') else [y, chroma]
    result = image_to_array(image_message(np.dstack(order), encoding, padding))
    assert result.dtype == np.uint8 and result.shape == (*y.shape, 3)
    expected = bgr_of(y, np.repeat(chroma[:, ::2], 2, 1), np.repeat(chroma[:, 1::2], 2, 1))
    assert np.abs(result - expected).max() <= 1.5


@pytest.mark.parametrize('encoding', PLANAR)
@given(y=npst.arrays(np.uint8, EVEN), seed=st.integers(0, 99), padding=PADDING)
def test_yuv_of_two_planes_follows_the_equations(encoding, y, seed, padding):
    chroma = np.random.default_rng(seed).integers(0, 256, (len(y) // 2, y.shape[1]), np.uint8)
    message = image_message(np.vstack([y, chroma]), encoding, padding)
    message.height = len(y)
    u, v = (np.repeat(np.repeat(chroma[:, start::2], 2, 0), 2, 1) for start in (0, 1))
    expected = bgr_of(y, u, v) if encoding == 'nv12' else bgr_of(y, v, u)
    assert np.abs(image_to_array(message) - expected).max() <= 1.5


@pytest.mark.parametrize(('encoding', 'width', 'height', 'told'), [
    ('uyvy', 5, 4, 'has width 5 px'), ('yuyv', 5, 3, 'has width 5 px'), ('nv12', 4, 3, 'has height 3 px'),
    ('nv21', 5, 3, 'has width 5 and height 3 px')])
def test_yuv_of_odd_sides_is_refused(encoding, width, height, told):
    message = Image(height=height, width=width, encoding=encoding, step=20, data=[0] * 100)
    with pytest.raises(ValueError, match=f'{told}, it must be even'):
        image_to_array(message)
