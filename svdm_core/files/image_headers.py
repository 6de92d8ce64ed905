"""What an image file declares, read before anything decodes it: a few bytes can claim any size, and decoding reserves
memory for it.
"""
from __future__ import annotations

import re
import struct
from collections.abc import Callable, Iterator

LARGEST = 64_000_000
"""Most pixels an image may declare."""
KINDS = 'PNG, JPEG, BMP, TIFF, PGM, PPM or WebP'
_PNG = b'\x89PNG\r\n\x1a\n'
_PNG_HEADER = b'\x00\x00\x00\rIHDR'
_JPEG = b'\xff\xd8\xff'
_START_OF_FRAME = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""Markers of the JPEG segments that hold height and width."""
_WITHOUT_LENGTH = frozenset([0x01, *range(0xD0, 0xD9)])
_START_OF_SCAN, _END = 0xDA, 0xD9
_PORTABLE_HEADER = 1000
"""Bytes of a PGM or PPM within which its size stands."""
_TIFF_WIDTH, _TIFF_HEIGHT = 256, 257
_TIFF_NUMBERS = {3: 'H', 4: 'I'}
_TIFF_TAGS = 1000

Size = tuple[int, int]


def is_png_or_jpeg(data: bytes) -> bool:
    """Whether it begins as one."""
    return data.startswith((_PNG, _JPEG))


def declared_size(data: bytes) -> Size | None:
    """Width and height, px, of a PNG, JPEG, BMP, TIFF, PGM, PPM, PBM, PFM or WebP; None where it is none of them."""
    for begin, read in _READERS.items():
        if data.startswith(begin):
            try:
                return read(data)
            except (struct.error, ValueError, IndexError, KeyError):
                return None
    return None


def check_size(width: int, height: int) -> None:
    """Raise ValueError where an image has no pixels, or more than LARGEST."""
    if width == 0 or height == 0:
        raise ValueError(f'the image is empty: {width}x{height} px')
    if width * height > LARGEST:
        raise ValueError(f'the image declares {width}x{height} px, at most {LARGEST} px are allowed: make it smaller')


def _png(data: bytes) -> Size | None:
    if data[8:16] != _PNG_HEADER or len(data) < 24:
        return None
    return int.from_bytes(data[16:20]), int.from_bytes(data[20:24])


def _jpeg(data: bytes) -> Size | None:
    for marker, body in _jpeg_segments(data):
        if marker in _START_OF_FRAME and len(body) >= 5:
            return int.from_bytes(body[3:5]), int.from_bytes(body[1:3])
    return None


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


def _bmp(data: bytes) -> Size:
    """In the form of OS/2 with 16 bits each; a negative height is one from the top."""
    [header] = struct.unpack_from('<I', data, 14)
    width, height = struct.unpack_from('<HH' if header == 12 else '<ii', data, 18)
    return abs(width), abs(height)


def _portable(data: bytes) -> Size:
    """Two numbers behind the kind, with comments between."""
    text = re.sub(rb'#[^\n]*', b' ', data[2:_PORTABLE_HEADER])
    width, height = text.split(None, 2)[:2]
    return int(width), int(height)


def _webp(data: bytes) -> Size | None:
    kind, body = data[12:16], data[20:30]
    if data[8:12] != b'WEBP' or len(body) < 10:
        return None
    if kind == b'VP8X':
        return 1 + int.from_bytes(body[4:7], 'little'), 1 + int.from_bytes(body[7:10], 'little')
    if kind == b'VP8L':
        bits = int.from_bytes(body[1:5], 'little')
        return 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    width, height = struct.unpack_from('<HH', body, 6)
    return width & 0x3FFF, height & 0x3FFF


def _tiff(data: bytes) -> Size:
    """By the first directory of the file, whose image is the one that is decoded."""
    order = '<' if data.startswith(b'II') else '>'
    [place] = struct.unpack_from(f'{order}I', data, 4)
    [count] = struct.unpack_from(f'{order}H', data, place)
    numbers = {}
    for at in range(place + 2, place + 2 + 12 * min(count, _TIFF_TAGS), 12):
        tag, kind = struct.unpack_from(f'{order}HH', data, at)
        if tag in (_TIFF_WIDTH, _TIFF_HEIGHT):
            [numbers[tag]] = struct.unpack_from(f'{order}{_TIFF_NUMBERS[kind]}', data, at + 8)
    return numbers[_TIFF_WIDTH], numbers[_TIFF_HEIGHT]


_READERS: dict[bytes, Callable[[bytes], Size | None]] = {
    _PNG: _png, _JPEG: _jpeg, b'BM': _bmp, b'II*\x00': _tiff, b'MM\x00*': _tiff, b'RIFF': _webp,
    **{b'P%d' % kind: _portable for kind in range(1, 7)}, b'PF': _portable, b'Pf': _portable}
