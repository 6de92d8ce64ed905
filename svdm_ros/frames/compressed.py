"""sensor_msgs/CompressedImage to pixels: JPEG and PNG, as compressed_image_transport and drivers write them."""
from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from svdm_core.memory import is_out_of_memory

if TYPE_CHECKING:
    from sensor_msgs.msg import CompressedImage

    Pixels = NDArray[np.uint8] | NDArray[np.uint16]

LARGEST = 64_000_000
"""Most pixels an image may declare: a few bytes can claim any size, and decoding reserves memory for it."""

_PNG = b'\x89PNG\r\n\x1a\n'
_PNG_HEADER = b'\x00\x00\x00\rIHDR'
_JPEG = b'\xff\xd8\xff'
_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of the JPEG segments that hold height and width."""
_WITHOUT_LENGTH = frozenset([0x01, *range(0xD0, 0xD9)])
_START_OF_SCAN, _END = 0xDA, 0xD9
_MOSAICS = ('bayer_rggb', 'bayer_bggr', 'bayer_gbrg', 'bayer_grbg')
_ENCODINGS = {(1, 1): 'mono8', (1, 2): 'mono16', (3, 1): 'bgr8', (3, 2): 'bgr16', (4, 1): 'bgra8', (4, 2): 'bgra16'}
"""By channels and bytes a channel: what OpenCV decodes to."""
_SHOWN = 200


def decode(message: CompressedImage) -> tuple[Pixels, str]:
    """The pixels of a sensor_msgs/CompressedImage of any library, and their encoding as sensor_msgs/Image names it.

    (H, W) mono8, mono16, bayer_*8 or bayer_*16, (H, W, 3) bgr8 or bgr16, (H, W, 4) bgra8 or bgra16; uint8 or uint16.
    A mosaic is grey in the file, and known by `format`: 'bayer_rggb8; png compressed'. Whether it is JPEG or PNG is
    told by the data, not by `format`.
    Raises ValueError, in one line, for anything else or damaged, for compressedDepth, for a mosaic of unknown pattern,
    and where width times height, read before decoding, is more than LARGEST.
    """
    stored_format = str(message.format)
    data = np.frombuffer(message.data, np.uint8)
    if 'compresseddepth' in stored_format.lower():
        raise ValueError(f'format {_shown(stored_format)} is compressedDepth, which holds a depth map: give the topic '
                         'of the camera image')
    _check_size(*_declared_size(data.tobytes(), stored_format))
    try:
        pixels: Any = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        if is_out_of_memory(error):
            raise
        pixels = None
    if pixels is None:
        raise ValueError(f'its {data.size} bytes of format {_shown(stored_format)} are a damaged or unusual image: '
                         'OpenCV cannot decode it')
    return pixels, _encoding(pixels, stored_format)


def _encoding(pixels: NDArray[Any], stored_format: str) -> str:
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    original = stored_format.partition(';')[0].strip()
    if channels == 1 and original.startswith('bayer_'):
        pattern = original.removesuffix('16').removesuffix('8')
        if pattern not in _MOSAICS:
            raise ValueError(f'format {_shown(stored_format)} names an unknown mosaic: it must be one of '
                             f'{", ".join(_MOSAICS)}, with 8 or 16')
        return f'{pattern}{8 * pixels.itemsize}'
    encoding = _ENCODINGS.get((channels, pixels.itemsize)) if pixels.dtype.kind == 'u' else None
    if encoding is None:
        raise ValueError(f'format {_shown(stored_format)} holds {channels} channels of {pixels.dtype}: grey, BGR or '
                         'BGRA of 8 or 16 bits can be used')
    return encoding


# What the data declare, before memory is reserved for it


def _declared_size(data: bytes, stored_format: str) -> tuple[int, int]:
    """Width and height, px, from the header of a PNG or JPEG."""
    if data.startswith(_PNG) and data[8:16] == _PNG_HEADER and len(data) >= 24:
        return int.from_bytes(data[16:20]), int.from_bytes(data[20:24])
    if data.startswith(_JPEG):
        for marker, body in _jpeg_segments(data):
            if marker in _START_OF_FRAME and len(body) >= 5:
                return int.from_bytes(body[3:5]), int.from_bytes(body[1:3])
    raise ValueError(f'its {len(data)} bytes of format {_shown(stored_format)} are no JPEG or PNG that can be read: '
                     'use jpeg or png compression')


def _jpeg_segments(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Marker and body of the segments before the pixels. Bytes between them are passed over, as decoders do."""
    place = 2
    while (place := data.find(b'\xff', place)) >= 0:
        while place < len(data) and data[place] == 0xFF:  # any number may fill
            place += 1
        if place + 3 > len(data):
            return
        marker = data[place]
        place += 1
        if marker in (_START_OF_SCAN, _END):
            return
        if marker == 0 or marker in _WITHOUT_LENGTH:
            continue
        length = int.from_bytes(data[place:place + 2])
        yield marker, data[place + 2:place + length]
        place += max(length, 2)


def _check_size(width: int, height: int) -> None:
    if width == 0 or height == 0:
        raise ValueError(f'the image is empty: {width}x{height} px')
    if width * height > LARGEST:
        raise ValueError(f'the image declares {width}x{height} px, at most {LARGEST} px are allowed: publish smaller '
                         'images')


def _shown(text: str) -> str:
    cut = repr(text[:_SHOWN])
    return cut if len(text) <= _SHOWN else f'{cut}... ({len(text)} characters)'
