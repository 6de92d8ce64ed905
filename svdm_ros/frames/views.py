"""From messages to two rectified images: decoded, taken apart where one holds both, rectified where they are raw."""
from __future__ import annotations

import dataclasses
import sys
from typing import TYPE_CHECKING, Any, Literal, NamedTuple, cast

import numpy as np
from numpy.typing import NDArray

from ..calibration.rectification import RectificationCache
from .compressed import decode
from .image_conversion import image_to_array
from .side_by_side import half_info, halves

if TYPE_CHECKING:
    from sensor_msgs.msg import CameraInfo, CompressedImage, Image

Side = Literal['left', 'right']
Pixels = NDArray[np.uint8] | NDArray[np.uint16]


@dataclasses.dataclass(frozen=True, slots=True)
class StereoFrame:
    """What one computation starts from.

    left, right: one and the same message where it holds both views side by side. arrived: when, s: monotonic time of
    the later image in the node, the left stamp in a recording. raw: whether the images are to be rectified.
    """

    left: Image | CompressedImage
    right: Image | CompressedImage
    left_info: CameraInfo | None
    right_info: CameraInfo | None
    arrived: float
    raw: bool = False


class FrameError(ValueError):
    """A pair that cannot be matched. `reason` is the short name it is counted under; the text says what to do."""

    def __init__(self, reason: str, text: str) -> None:
        super().__init__(text)
        self.reason = reason


class View(NamedTuple):
    """One camera's image, uint8 or uint16, (H, W) or (H, W, 3) BGR, its encoding in the message, its camera_info."""

    pixels: Pixels
    encoding: str
    info: CameraInfo | None


class Views:
    """Makes the two views of a frame; keeps the maps of raw cameras until their calibration changes."""

    def __init__(self) -> None:
        self._maps: dict[Side, RectificationCache] = {'left': RectificationCache(), 'right': RectificationCache()}

    def of(self, frame: StereoFrame) -> tuple[View, View]:
        """The left and the right view, of the same shape and type. Raises FrameError."""
        if frame.left is frame.right:
            left, right = _halves(frame)
        else:
            left = _view(frame.left, frame.left_info, 'left')
            right = _view(frame.right, frame.right_info, 'right')
        _check_alike(left, right)
        if frame.raw:
            left, right = self._rectified(left, 'left'), self._rectified(right, 'right')
        return left, right

    def _rectified(self, view: View, side: Side) -> View:
        if view.info is None:
            raise FrameError('not calibrated', f'pair dropped: raw images are rectified by camera_info, and no '
                                               f'{side}/camera_info has come: publish or remap it, or set input to '
                                               'rectified')
        height, width = view.pixels.shape[:2]
        try:
            return view._replace(pixels=self._maps[side].of(view.info, width, height)(view.pixels))
        except ValueError as error:
            raise FrameError('not rectified', f'pair dropped, {side}/camera_info cannot rectify it: {error}') from error


def image_pixels(message: Image | CompressedImage) -> tuple[Pixels, str]:
    """The pixels of an image of any kind, uint8 or uint16, (H, W) or (H, W, 3) BGR, and its encoding. Raises ValueError
    where it is damaged, or of a kind that is not known."""
    image = message if hasattr(message, 'encoding') else _decoded(message)
    return image_to_array(image), str(image.encoding)


def _view(message: Image | CompressedImage, info: CameraInfo | None, side: str) -> View:
    try:
        return View(*image_pixels(message), info)
    except ValueError as error:
        raise FrameError('unreadable', f'{side} image dropped: {error}') from error


def _halves(frame: StereoFrame) -> tuple[View, View]:
    whole = _view(frame.left, None, 'side-by-side')
    height, width = whole.pixels.shape[:2]
    try:
        left, right = (cast(Pixels, half) for half in halves(whole.pixels))
    except ValueError as error:
        raise FrameError('unreadable', f'side-by-side image dropped: {error}') from error
    left_info, right_info = (info and _info_of_half(info, side, width, height) for info, side in _infos(frame))
    return whole._replace(pixels=left, info=left_info), whole._replace(pixels=right, info=right_info)


def _infos(frame: StereoFrame) -> tuple[tuple[CameraInfo | None, Side], ...]:
    return (frame.left_info, 'left'), (frame.right_info, 'right')


def _info_of_half(info: CameraInfo, side: Side, width: int, height: int) -> CameraInfo:
    try:
        return half_info(info, side, width, height)
    except ValueError:
        return info  # whoever uses it tells what is wrong with it


class _Decoded(NamedTuple):
    """The fields of sensor_msgs/Image that say how its data is read."""

    height: int
    width: int
    encoding: str
    is_bigendian: int
    step: int
    data: Any


def _decoded(message: CompressedImage) -> _Decoded:
    pixels, encoding = decode(message)
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).reshape(-1).view(np.uint8)
    return _Decoded(height, width, encoding, int(sys.byteorder == 'big'), data.size // height, data)


def _check_alike(left: View, right: View) -> None:
    if left.pixels.shape[:2] != right.pixels.shape[:2]:
        raise FrameError(
            'sizes differ',
            f'pair dropped: the left image has {_size(left)} px, the right {_size(right)}: rectify both to the same '
            'size')
    if left.pixels.shape != right.pixels.shape or left.pixels.dtype != right.pixels.dtype:
        raise FrameError(
            'encodings differ',
            f'pair dropped: the left image is {left.encoding}, the right {right.encoding}: publish both in the same '
            'encoding')


def _size(view: View) -> str:
    height, width = view.pixels.shape[:2]
    return f'{width}x{height}'
