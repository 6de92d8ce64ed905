"""sensor_msgs/Image to numpy, without a copy wherever the pixels can stay where they are."""
from __future__ import annotations

import dataclasses
import sys
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from svdm_core.shown import shown

if TYPE_CHECKING:
    from sensor_msgs.msg import Image


@dataclasses.dataclass(frozen=True, slots=True)
class _Layout:
    """Channels and bytes a channel as stored; which stored channels are B, G, R.

    mosaic, yuv: OpenCV's code for a mosaic, and for luma with chroma of every second pixel; half_rows: rows of chroma
    follow, half as many as rows of pixels; is_float: the channel is a float32.
    """

    channels: int = 1
    bytes_per_channel: int = 1
    bgr: slice | None = None
    mosaic: int | None = None
    yuv: int | None = None
    half_rows: bool = False
    is_float: bool = False


_BGR = slice(0, 3)
_RGB = slice(2, None, -1)
_UYVY = _Layout(2, yuv=cv2.COLOR_YUV2BGR_UYVY)
_YUYV = _Layout(2, yuv=cv2.COLOR_YUV2BGR_YUYV)
# ROS and the long OpenCV names tell the upper left 2x2 pixels; OpenCV's short names (BayerBG) are shifted by one.
_MOSAICS = {'rggb': cv2.COLOR_BayerRGGB2BGR, 'bggr': cv2.COLOR_BayerBGGR2BGR,
            'gbrg': cv2.COLOR_BayerGBRG2BGR, 'grbg': cv2.COLOR_BayerGRBG2BGR}
_LAYOUTS = {  # named as in image_encodings.hpp of sensor_msgs
    'mono8': _Layout(),
    '8UC1': _Layout(),
    'mono16': _Layout(bytes_per_channel=2),
    '16UC1': _Layout(bytes_per_channel=2),
    '32FC1': _Layout(bytes_per_channel=4, is_float=True),
    'bgr8': _Layout(3, bgr=_BGR),
    '8UC3': _Layout(3, bgr=_BGR),
    'rgb8': _Layout(3, bgr=_RGB),
    'bgra8': _Layout(4, bgr=_BGR),
    '8UC4': _Layout(4, bgr=_BGR),
    'rgba8': _Layout(4, bgr=_RGB),
    'bgr16': _Layout(3, 2, bgr=_BGR),
    'rgb16': _Layout(3, 2, bgr=_RGB),
    'bgra16': _Layout(4, 2, bgr=_BGR),
    'rgba16': _Layout(4, 2, bgr=_RGB),
    'uyvy': _UYVY,
    'yuv422': _UYVY,
    'yuyv': _YUYV,
    'yuv422_yuy2': _YUYV,
    'nv12': _Layout(yuv=cv2.COLOR_YUV2BGR_NV12, half_rows=True),
    'nv21': _Layout(yuv=cv2.COLOR_YUV2BGR_NV21, half_rows=True),
    **{f'bayer_{pattern}8': _Layout(mosaic=code) for pattern, code in _MOSAICS.items()},
    **{f'bayer_{pattern}16': _Layout(bytes_per_channel=2, mosaic=code) for pattern, code in _MOSAICS.items()},
}
ENCODINGS = tuple(_LAYOUTS)
"""The encodings that `image_to_array` takes."""
_SMALLEST_MOSAIC = 3


def image_to_array(message: Image) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The pixels as uint8 or uint16, (H, W) grey or (H, W, 3) in the order B, G, R.

    A view into `message.data` (not always contiguous), except where the pixels have to be computed or moved: mosaics,
    YUV, floats, and 16 bits of the other byte order. YUV is taken as BT.601 with luma 16 to 235, as OpenCV and
    cv_bridge have it. Floats are 0 to 1, and become 0 to 65535.
    Raises ValueError naming what is wrong: encoding, an empty image, odd sides of YUV, step or length of the data, a
    float that is NaN or outside 0 to 1.
    """
    layout = _LAYOUTS.get(message.encoding)
    if layout is None:
        raise ValueError(f'encoding {shown(message.encoding)} is not supported: use one of {", ".join(ENCODINGS)}')
    stored = _channels(_bytes(message, layout), layout, big_endian=bool(message.is_bigendian))
    if layout.is_float:
        return _sixteen_bits_of(stored)
    if layout.yuv is not None:
        return np.asarray(cv2.cvtColor(stored, layout.yuv), np.uint8)
    if layout.mosaic is not None:
        return _demosaiced(stored, layout.mosaic)
    return stored if layout.bgr is None else stored[:, :, layout.bgr]


def _bytes(message: Image, layout: _Layout) -> NDArray[np.uint8]:
    """The bytes of the pixels (rows, W * bytes per pixel), row padding left out; rows of chroma follow, if any."""
    height, width, step = message.height, message.width, message.step
    if height == 0 or width == 0:
        raise ValueError(f'the image is empty: {width}x{height} px')
    _check_even(message, layout)
    row_bytes = width * layout.channels * layout.bytes_per_channel
    if step < row_bytes:
        raise ValueError(f'step is {step} bytes, a row of {width} px in {message.encoding} has {row_bytes}')
    rows = height * 3 // 2 if layout.half_rows else height
    if len(message.data) != step * rows:
        chroma = f' and {rows - height} of chroma' if layout.half_rows else ''
        raise ValueError(
            f'the data has {len(message.data)} bytes, {height} rows{chroma} of {step} bytes make {step * rows}'
        )
    return np.frombuffer(message.data, np.uint8).reshape(rows, step)[:, :row_bytes]


def _check_even(message: Image, layout: _Layout) -> None:
    if layout.yuv is None:
        return
    odd = [f'{name} {px}' for name, px, halved in (
        ('width', message.width, True), ('height', message.height, layout.half_rows)) if halved and px % 2]
    if odd:
        raise ValueError(f'the image in {message.encoding} has {" and ".join(odd)} px, it must be even, as chroma is '
                         'of every second pixel: crop it by one pixel')


def _channels(stored: NDArray[np.uint8], layout: _Layout, *, big_endian: bool) -> NDArray[Any]:
    """(rows, W), or (rows, W, channels) where there are several, in this machine's byte order."""
    if layout.bytes_per_channel > 1:
        stored = _native(stored, np.dtype('f4' if layout.is_float else f'u{layout.bytes_per_channel}'), big_endian)
    return stored if layout.channels == 1 else stored.reshape(len(stored), -1, layout.channels)


def _native(stored: NDArray[np.uint8], dtype: np.dtype[Any], big_endian: bool) -> NDArray[Any]:
    values = stored.view(dtype.newbyteorder('>' if big_endian else '<'))
    native = big_endian == (sys.byteorder == 'big')
    if native and values.flags.aligned:
        return values.view(dtype)
    return values.astype(dtype)


def _sixteen_bits_of(values: NDArray[np.float32]) -> NDArray[np.uint16]:
    wrong = ~((values >= 0) & (values <= 1))
    if wrong.any():
        row, column = np.unravel_index(int(wrong.argmax()), wrong.shape)
        raise ValueError(f'the image in 32FC1 holds {values[row, column]:g} at ({column}, {row}), grey must be 0 to 1: '
                         'scale it, or publish mono8 or mono16')
    return np.rint(values * np.float32(65535)).astype(np.uint16)


def _demosaiced(pixels: NDArray[Any], code: int) -> NDArray[Any]:
    height, width = pixels.shape
    if min(height, width) < _SMALLEST_MOSAIC:
        needed = f'{_SMALLEST_MOSAIC}x{_SMALLEST_MOSAIC}'
        raise ValueError(f'a bayer image of {width}x{height} px is too small: it needs {needed}')
    return np.asarray(cv2.cvtColor(pixels, code), pixels.dtype)


def pixels_of(image: Any) -> NDArray[np.float32]:
    """The values of a sensor_msgs/Image of encoding 32FC1, float32 (H, W). Raises ValueError for another encoding."""
    if image.encoding != '32FC1':
        raise ValueError(f'encoding {shown(image.encoding)} holds no disparity: it must be 32FC1')
    if image.step < 4 * image.width or len(image.data) != image.height * image.step or not image.width:
        raise ValueError(f'{len(image.data)} bytes are no {image.width}x{image.height} px of 32FC1 with a step of '
                         f'{image.step}')
    stored = np.frombuffer(image.data, np.uint8).reshape(image.height, image.step)[:, :4 * image.width]
    values = np.ascontiguousarray(stored).view('>f4' if image.is_bigendian else '<f4')
    return values if sys.byteorder == 'little' and not image.is_bigendian else values.astype(np.float32)
