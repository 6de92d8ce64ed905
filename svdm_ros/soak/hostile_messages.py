"""Messages as no camera should send them: of each type the node subscribes to, and bytes that are no message at all."""
from __future__ import annotations

import array
import random
from collections.abc import Callable
from typing import Any

from rclpy.serialization import serialize_message
from sensor_msgs.msg import CameraInfo, CompressedImage, Image

from ..frames.image_conversion import ENCODINGS

_TEXTS = ('', 'x' * 5000, 'mono8\0', 'BGR8', '32FC4', '\x1b[2J', 'line\nline', '8UC999999', 'äöü€', 'bayer_')
_FORMATS = ('jpeg', 'png', 'mono8; jpeg compressed bgr8', '16UC1; compressedDepth png',
            'bayer_xxxx8; png compressed', '')
_SIZES = (0, 1, 2, 3, 7, 16, 64, 65535, 2**31, 2**32 - 1)
_NUMBERS = (0.0, -0.0, 1.0, -1.0, 100.0, 1e-320, 1e308, -1e308, float('nan'), float('inf'), float('-inf'))
_PNG = b'\x89PNG\r\n\x1a\n\x00\x00\x00\rIHDR'
_JPEG = b'\xff\xd8\xff\xc0\x00\x11\x08'
_MOST_BYTES = 4000


def hostile_image(chance: random.Random) -> Image:
    """With any encoding, size, step and amount of data; many are nearly right."""
    width, height = chance.choice(_SIZES), chance.choice(_SIZES)
    if chance.random() < 0.5:
        width, height = chance.randint(1, 40), chance.randint(1, 40)
    step = chance.choice((width, 3 * width, 0, 2**32 - 1, width + 5)) % 2**32
    right_size = step * height if step * height < _MOST_BYTES else chance.randrange(_MOST_BYTES)
    size = chance.choice((right_size, right_size + 1, 0, chance.randrange(_MOST_BYTES)))
    message = Image(height=height, width=width, encoding=chance.choice((*ENCODINGS, *_TEXTS)), step=step,
                    is_bigendian=chance.choice((0, 1, 255)), data=array.array('B', chance.randbytes(size)))
    return _stamped(message, chance)


def hostile_info(chance: random.Random) -> CameraInfo:
    """With any numbers in any place."""
    def numbers(count: int) -> list[float]:
        return [chance.choice(_NUMBERS) for _ in range(count)]

    message = CameraInfo(
        width=chance.choice(_SIZES), height=chance.choice(_SIZES), binning_x=chance.choice(_SIZES),
        binning_y=chance.choice(_SIZES), distortion_model=chance.choice((*_TEXTS, 'plumb_bob', 'equidistant')),
        d=numbers(chance.choice((0, 4, 5, 8, 100))), k=numbers(9), r=numbers(9), p=numbers(12))
    for name in ('x_offset', 'y_offset', 'width', 'height'):
        setattr(message.roi, name, chance.choice(_SIZES))
    return _stamped(message, chance)


def hostile_compressed(chance: random.Random) -> CompressedImage:
    """Damaged JPEG and PNG, of which the header may claim any size."""
    data = chance.choice((_PNG, _JPEG, b'')) + chance.randbytes(chance.randrange(_MOST_BYTES))
    return _stamped(CompressedImage(format=chance.choice((*_FORMATS, *_TEXTS)), data=array.array('B', data)), chance)


MAKERS: dict[type, Callable[[random.Random], Any]] = {
    Image: hostile_image, CameraInfo: hostile_info, CompressedImage: hostile_compressed}


def hostile_bytes(chance: random.Random, message: Any) -> bytes:
    """A serialized message (CDR) with bytes changed, cut off or added."""
    data = bytearray(serialize_message(message))
    for _ in range(chance.randint(1, 8)):
        data[chance.randrange(len(data))] = chance.choice((0, 1, 127, 128, 255))
    return bytes(chance.choice((data, data[:chance.randrange(len(data))], data + chance.randbytes(16))))


def _stamped[Message](message: Message, chance: random.Random) -> Message:
    stamp = message.header.stamp  # type: ignore[attr-defined]
    stamp.sec = chance.choice((0, -1, 2**31 - 1, -2**31, chance.randrange(2**31)))
    stamp.nanosec = chance.choice((0, 999_999_999, 2**32 - 1))
    message.header.frame_id = chance.choice(_TEXTS).replace('\0', '')  # type: ignore[attr-defined]
    return message
