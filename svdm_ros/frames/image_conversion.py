"""sensor_msgs/Image to numpy, without a copy wherever the pixels can stay where they are."""
from __future__ import annotations

import dataclasses
import sys
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from sensor_msgs.msg import Image


@dataclasses.dataclass(frozen=True, slots=True)
class _Layout:
    """Channels and bytes a channel as stored; which stored channels are B, G, R; OpenCV's code for a mosaic."""

    channels: int = 1
    bytes_per_channel: int = 1
    bgr: slice | None = None
    mosaic: int | None = None


_BGR = slice(0, 3)
_LAYOUTS = {
    'mono8': _Layout(),
    '8UC1': _Layout(),
    'mono16': _Layout(bytes_per_channel=2),
    '16UC1': _Layout(bytes_per_channel=2),
    'bgr8': _Layout(3, bgr=_BGR),
    '8UC3': _Layout(3, bgr=_BGR),
    'rgb8': _Layout(3, bgr=slice(2, None, -1)),
    'bgra8': _Layout(4, bgr=_BGR),
    'rgba8': _Layout(4, bgr=slice(2, None, -1)),
    # ROS and the long OpenCV names tell the upper left 2x2 pixels; OpenCV's short names (BayerBG) are shifted by one.
    'bayer_rggb8': _Layout(mosaic=cv2.COLOR_BayerRGGB2BGR),
    'bayer_bggr8': _Layout(mosaic=cv2.COLOR_BayerBGGR2BGR),
    'bayer_gbrg8': _Layout(mosaic=cv2.COLOR_BayerGBRG2BGR),
    'bayer_grbg8': _Layout(mosaic=cv2.COLOR_BayerGRBG2BGR),
}
ENCODINGS = tuple(_LAYOUTS)
"""The encodings that `image_to_array` takes."""
_SMALLEST_MOSAIC = 3


def image_to_array(message: Image) -> NDArray[np.uint8] | NDArray[np.uint16]:
    """The pixels as uint8 or uint16, (H, W) grey or (H, W, 3) in the order B, G, R.

    A view into `message.data` (not always contiguous) but for mosaics and for 16 bits that have to be moved.
    Raises ValueError naming what is wrong: encoding, an empty image, step or length of the data.
    """
    layout = _LAYOUTS.get(message.encoding)
    if layout is None:
        raise ValueError(f'encoding {message.encoding!r} is not supported: use one of {", ".join(ENCODINGS)}')
    pixels = _pixels(message, layout)
    if layout.bytes_per_channel == 2:
        return _sixteen_bit(pixels, big_endian=bool(message.is_bigendian))
    if layout.mosaic is not None:
        return _demosaiced(pixels, layout.mosaic)
    if layout.bgr is not None:
        return pixels.reshape(message.height, message.width, layout.channels)[:, :, layout.bgr]
    return pixels


def _pixels(message: Image, layout: _Layout) -> NDArray[np.uint8]:
    """The bytes of the pixels (H, W * bytes per pixel), row padding left out."""
    height, width, step = message.height, message.width, message.step
    if height == 0 or width == 0:
        raise ValueError(f'the image is empty: {width}x{height} px')
    row_bytes = width * layout.channels * layout.bytes_per_channel
    if step < row_bytes:
        raise ValueError(f'step is {step} bytes, a row of {width} px in {message.encoding} has {row_bytes}')
    if len(message.data) != step * height:
        raise ValueError(
            f'the data has {len(message.data)} bytes, {height} rows of {step} bytes make {step * height}'
        )
    return np.frombuffer(message.data, np.uint8).reshape(height, step)[:, :row_bytes]


def _sixteen_bit(pixels: NDArray[np.uint8], *, big_endian: bool) -> NDArray[np.uint16]:
    stored = pixels.view('>u2' if big_endian else '<u2')
    native = big_endian == (sys.byteorder == 'big')
    if native and stored.flags.aligned:
        return stored.view(np.uint16)
    return stored.astype(np.uint16)


def _demosaiced(pixels: NDArray[np.uint8], code: int) -> NDArray[np.uint8]:
    height, width = pixels.shape
    if min(height, width) < _SMALLEST_MOSAIC:
        needed = f'{_SMALLEST_MOSAIC}x{_SMALLEST_MOSAIC}'
        raise ValueError(f'a bayer image of {width}x{height} px is too small: it needs {needed}')
    return np.asarray(cv2.cvtColor(pixels, code), np.uint8)
