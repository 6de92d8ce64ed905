"""sensor_msgs/CompressedImage to pixels: JPEG and PNG, as compressed_image_transport and drivers write them."""
from __future__ import annotations

from typing import TYPE_CHECKING, Any

import cv2
import numpy as np
from numpy.typing import NDArray

from svdm_core.files.image_headers import check_size, declared_size, is_png_or_jpeg
from svdm_core.memory import is_out_of_memory
from svdm_core.shown import shown

if TYPE_CHECKING:
    from sensor_msgs.msg import CompressedImage

    Pixels = NDArray[np.uint8] | NDArray[np.uint16]

_MOSAICS = ('bayer_rggb', 'bayer_bggr', 'bayer_gbrg', 'bayer_grbg')
_ENCODINGS = {(1, 1): 'mono8', (1, 2): 'mono16', (3, 1): 'bgr8', (3, 2): 'bgr16', (4, 1): 'bgra8', (4, 2): 'bgra16'}
"""By channels and bytes a channel: what OpenCV decodes to."""


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
        raise ValueError(f'format {shown(stored_format)} is compressedDepth, which holds a depth map: give the topic '
                         'of the camera image')
    content = data.tobytes()
    size = declared_size(content) if is_png_or_jpeg(content) else None
    if size is None:
        raise ValueError(f'its {data.size} bytes of format {shown(stored_format)} are no JPEG or PNG that can be '
                         'read: use jpeg or png compression')
    check_size(*size)
    try:
        pixels: Any = cv2.imdecode(data, cv2.IMREAD_UNCHANGED)
    except cv2.error as error:
        if is_out_of_memory(error):
            raise
        pixels = None
    if pixels is None:
        raise ValueError(f'its {data.size} bytes of format {shown(stored_format)} are a damaged or unusual image: '
                         'OpenCV cannot decode it')
    return pixels, _encoding(pixels, stored_format)


def _encoding(pixels: NDArray[Any], stored_format: str) -> str:
    channels = pixels.shape[2] if pixels.ndim == 3 else 1
    original = stored_format.partition(';')[0].strip()
    if channels == 1 and original.startswith('bayer_'):
        pattern = original.removesuffix('16').removesuffix('8')
        if pattern not in _MOSAICS:
            raise ValueError(f'format {shown(stored_format)} names an unknown mosaic: it must be one of '
                             f'{", ".join(_MOSAICS)}, with 8 or 16')
        return f'{pattern}{8 * pixels.itemsize}'
    encoding = _ENCODINGS.get((channels, pixels.itemsize)) if pixels.dtype.kind == 'u' else None
    if encoding is None:
        raise ValueError(f'format {shown(stored_format)} holds {channels} channels of {pixels.dtype}: grey, BGR or '
                         'BGRA of 8 or 16 bits can be used')
    return encoding


