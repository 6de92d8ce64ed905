"""sensor_msgs/CompressedImage: what comes out, what is told by the format, and what is refused before it is decoded."""
import array
import struct
import zlib
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import noise

from svdm_core.files.image_headers import LARGEST
from svdm_ros.frames.compressed import decode
from svdm_ros.frames.image_conversion import image_to_array


def message(data, stored_format='png'):
    return SimpleNamespace(format=stored_format, data=np.frombuffer(bytes(data), np.uint8))


def packed(pixels, suffix='png'):
    return cv2.imencode(f'.{suffix}', pixels)[1].tobytes()


def png(width, height, kind=0, bits=8, rows=b''):
    """A PNG from its parts; kind: 0 grey, 2 RGB, 4 grey and alpha."""
    def chunk(name, body):
        return struct.pack('>I', len(body)) + name + body + struct.pack('>I', zlib.crc32(name + body))

    header = struct.pack('>IIBBBBB', width, height, bits, kind, 0, 0, 0)
    return b'\x89PNG\r\n\x1a\n' + chunk(b'IHDR', header) + chunk(b'IDAT', zlib.compress(rows)) + chunk(b'IEND', b'')


def smooth(*shape):
    return cv2.GaussianBlur(noise(*shape), (0, 0), 3)


def sized(jpeg, width, height):
    """A JPEG that declares another size."""
    place = jpeg.index(b'\xff\xc0') + 5
    return jpeg[:place] + struct.pack('>HH', height, width) + jpeg[place + 4:]


@pytest.mark.parametrize(('shape', 'dtype', 'encoding'), [
    ((7, 9), np.uint8, 'mono8'), ((7, 9), np.uint16, 'mono16'), ((7, 9, 3), np.uint8, 'bgr8'),
    ((7, 9, 3), np.uint16, 'bgr16'), ((7, 9, 4), np.uint8, 'bgra8'), ((7, 9, 4), np.uint16, 'bgra16')])
def test_png_is_lossless(shape, dtype, encoding):
    pixels = noise(*shape, dtype=dtype)
    found, name = decode(message(packed(pixels)))
    assert name == encoding
    assert found.dtype == dtype
    np.testing.assert_array_equal(found, pixels)


def test_channels_and_16_bits_are_those_of_the_file():
    """From the bytes of the file, without OpenCV's encoder: RGB comes out as BGR, and 16 bits are big-endian there."""
    found, name = decode(message(png(2, 1, 2, 8, b'\x00' + bytes([1, 2, 3, 4, 5, 6]))))
    assert name == 'bgr8' and found.tolist() == [[[3, 2, 1], [6, 5, 4]]]
    found, name = decode(message(png(2, 1, 0, 16, b'\x00\x01\x02\xff\xfe')))
    assert name == 'mono16' and found.tolist() == [[0x0102, 0xfffe]]


@pytest.mark.parametrize(('shape', 'encoding'), [((60, 90), 'mono8'), ((60, 90, 3), 'bgr8')])
@pytest.mark.parametrize('stored_format', ['jpeg', 'jpg', 'rgb8; jpeg compressed bgr8', 'png', ''])
def test_jpeg_is_near_and_told_by_its_data(shape, encoding, stored_format):
    pixels = smooth(*shape)
    found, name = decode(message(packed(pixels, 'jpg'), stored_format))
    assert name == encoding
    assert found.shape == shape
    assert np.abs(found.astype(int) - pixels).mean() < 2


@pytest.mark.parametrize('flags', [[cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_RST_INTERVAL, 1]])
def test_progressive_jpeg_and_restarts(flags):
    pixels = smooth(40, 56)
    found, _ = decode(message(cv2.imencode('.jpg', pixels, flags)[1]))
    assert np.abs(found.astype(int) - pixels).mean() < 2


def test_the_data_of_rclpy_are_taken():
    pixels = noise(5, 6)
    found, _ = decode(SimpleNamespace(format='png', data=array.array('B', packed(pixels))))
    np.testing.assert_array_equal(found, pixels)


@pytest.mark.parametrize('pattern', ['rggb', 'bggr', 'gbrg', 'grbg'])
@pytest.mark.parametrize('bits', [8, 16])
def test_a_mosaic_is_told_by_the_format(pattern, bits):
    pixels = noise(8, 10, dtype=np.dtype(f'u{bits // 8}').type)
    found, name = decode(message(packed(pixels), f'bayer_{pattern}{bits}; png compressed '))
    assert name == f'bayer_{pattern}{bits}'
    np.testing.assert_array_equal(found, pixels)
    image = SimpleNamespace(width=10, height=8, encoding=name, step=found.strides[0], is_bigendian=0,
                            data=found.tobytes())
    assert image_to_array(image).shape == (8, 10, 3)


def test_a_mosaic_that_was_reduced_or_made_colour_has_the_encoding_it_has():
    grey, colour = noise(8, 10), noise(8, 10, 3)
    assert decode(message(packed(grey, 'jpg'), 'bayer_rggb16; jpeg compressed '))[1] == 'bayer_rggb8'
    assert decode(message(packed(colour, 'jpg'), 'bayer_rggb8; jpeg compressed bgr8'))[1] == 'bgr8'


# What is refused


def refused(*parts):
    with pytest.raises(ValueError) as refusal:
        decode(message(*parts))
    line = str(refusal.value)
    assert line.isprintable() and len(line) < 500
    return line


@pytest.mark.parametrize('stored_format', ['16UC1; compressedDepth', '32FC1; compressedDepth png', 'COMPRESSEDDEPTH'])
def test_compressed_depth_is_refused_by_name(stored_format):
    assert 'compressedDepth, which holds a depth map' in refused(bytes(12) + packed(noise(4, 4)), stored_format)


@pytest.mark.parametrize(('width', 'height'), [(2**31 - 1, 2**31 - 1), (LARGEST + 1, 1), (8001, 8000)])
def test_a_png_that_declares_too_much_is_refused_before_decoding(width, height):
    line = refused(png(width, height))
    assert line.startswith(f'the image declares {width}x{height} px, at most 64000000 px are allowed')


def test_as_much_as_is_allowed_goes_to_the_decoder():
    assert 'damaged' in refused(png(8000, 8000)), 'it holds no pixels'


FAR = packed(noise(16, 16), 'jpg')
THUMBNAIL = sized(FAR, 16, 16)


@pytest.mark.parametrize('between', [
    b'', b'\xff' * 9, b'\xff\xfe\x00\x03a' + b'\x00\x12\xff\x00', b'\xff\xfe\x00\x06\xff\xc0\x00\x11',
    b'\xff\xe1' + struct.pack('>H', len(THUMBNAIL) + 2) + THUMBNAIL, b'\xff\x01'])
def test_a_jpeg_that_declares_too_much_is_refused_wherever_its_header_stands(between):
    huge = sized(FAR, 65500, 65500)
    assert 'declares 65500x65500 px' in refused(huge[:2] + between + huge[2:])


@pytest.mark.parametrize('marker', [0xC1, 0xC2, 0xC3, 0xC9, 0xCF])
def test_every_kind_of_jpeg_header_is_read(marker):
    huge = sized(FAR, 65500, 65500)
    assert 'declares 65500x65500 px' in refused(huge.replace(b'\xff\xc0', bytes([0xff, marker])))


@pytest.mark.parametrize('data', [png(0, 5), png(5, 0), sized(FAR, 16, 0), sized(FAR, 0, 16)])
def test_an_empty_image_is_refused(data):
    assert 'the image is empty' in refused(data)


@pytest.mark.parametrize(('data', 'told'), [
    (b'', 'its 0 bytes of format'), (bytes(99), 'its 99 bytes'), (packed(noise(9, 9))[:20], 'no JPEG or PNG'),
    (b'\xff\xd8\xff', 'no JPEG or PNG'), (b'\xff\xd8\xff\xd9', 'no JPEG or PNG'), (FAR[:4], 'no JPEG or PNG'),
    (packed(noise(9, 9), 'bmp'), 'no JPEG or PNG'), (packed(noise(9, 9), 'tiff'), 'no JPEG or PNG'),
    (packed(noise(9, 9))[:-40], 'damaged'), (FAR[:-40], 'damaged'), (sized(FAR, 16, 16)[:200], 'damaged')])
def test_what_is_no_whole_image_is_refused_with_its_format(data, told):
    line = refused(data, 'h264')
    assert told in line and "'h264'" in line


def test_a_format_is_cut_and_shown_in_one_line():
    line = refused(b'', 'evil\n\x1b[2J' * 9999)
    assert r'evil\n\x1b[2J' in line and '... (89991 characters)' in line


def test_a_mosaic_of_unknown_pattern_is_refused():
    assert "'bayer_rgbw8; png compressed' names an unknown mosaic" in refused(
        packed(noise(4, 4)), 'bayer_rgbw8; png compressed')


@settings(max_examples=300, deadline=None)
@given(suffix=st.sampled_from(['png', 'jpg']), place=st.integers(0, 400), byte=st.integers(0, 255),
       end=st.integers(0, 2000), head=st.booleans())
def test_damage_gives_pixels_or_a_value_error(suffix, place, byte, end, head):
    data = bytearray(packed(noise(16, 16), suffix))
    data[place % (40 if head else len(data))] = byte
    try:
        pixels, _ = decode(message(data[:end]))
    except ValueError as error:
        assert str(error).isprintable()
    else:
        assert 0 < pixels.shape[0] * pixels.shape[1] <= LARGEST
