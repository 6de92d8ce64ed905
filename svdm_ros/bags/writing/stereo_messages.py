"""Messages of a stereo pair as CDR bytes, made without ROS: images, camera_info, ground truth."""
from __future__ import annotations

import dataclasses
import sys
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from ...calibration.stereo_calibration import CameraCalibration, StereoCalibration
from ...frames.matched_frame import END_MARGIN

IMAGE, CAMERA_INFO = 'sensor_msgs/msg/Image', 'sensor_msgs/msg/CameraInfo'
DISPARITY_IMAGE = 'stereo_msgs/msg/DisparityImage'
TYPES = get_typestore(Stores.ROS2_JAZZY)
_HEADER, _TIME = TYPES.types['std_msgs/msg/Header'], TYPES.types['builtin_interfaces/msg/Time']
_ROI = TYPES.types['sensor_msgs/msg/RegionOfInterest']


@dataclasses.dataclass(frozen=True, slots=True)
class Moment:
    """What a header says: the stamp (ns) and the optical frame."""

    stamp: int
    frame_id: str

    def header(self) -> Any:
        """std_msgs/Header."""
        return _HEADER(_TIME(*divmod(self.stamp, 10**9)), self.frame_id)


def encoding_of(pixels: NDArray[Any]) -> str:
    """mono8 of uint8 (H, W), bgr8 of uint8 (H, W, 3), mono16 of uint16 (H, W), 32FC1 of float32 (H, W)."""
    if pixels.ndim == 3:
        return 'bgr8'
    return {np.dtype(np.uint8): 'mono8', np.dtype(np.uint16): 'mono16', np.dtype(np.float32): '32FC1'}[pixels.dtype]


def image_bytes(pixels: NDArray[Any], moment: Moment) -> bytes:
    """sensor_msgs/Image of pixels as `encoding_of` takes them."""
    return _cdr(_image(pixels, moment), IMAGE)


def camera_info_bytes(camera: CameraCalibration, moment: Moment) -> bytes:
    """sensor_msgs/CameraInfo of a camera whose size is known."""
    assert camera.size is not None
    width, height = camera.size
    model = 'rational_polynomial' if len(camera.d) > 5 else 'plumb_bob'
    info = TYPES.types[CAMERA_INFO](
        header=moment.header(), height=height, width=width, distortion_model=model, d=camera.d, k=camera.k.ravel(),
        r=camera.r.ravel(), p=camera.p.ravel(), binning_x=0, binning_y=0, roi=_ROI(0, 0, 0, 0, False))
    return _cdr(info, CAMERA_INFO)


def infos_of(calibration: StereoCalibration) -> tuple[Any, Any]:
    """sensor_msgs/CameraInfo of the left and the right camera; 0x0 px, which fits any image, where it has no size."""
    cameras = calibration.left, calibration.right
    left, right = (
        TYPES.deserialize_cdr(camera_info_bytes(dataclasses.replace(camera, size=camera.size or (0, 0)), Moment(0, '')),
                             CAMERA_INFO)
        for camera in cameras)
    return left, right


def ground_truth_bytes(truth: NDArray[np.float32], calibration: StereoCalibration, moment: Moment) -> bytes:
    """stereo_msgs/DisparityImage of x_left - x_right in px, float32 (H, W), not finite where unknown.

    In the convention of the message, d = x_left - x_right - (cx_left - cx_right); unknown is min_disparity - 1,
    and what is known lies between min_disparity and max_disparity.
    """
    known = np.isfinite(truth)
    disparity = truth - np.float32(calibration.principal_offset)
    low = float(np.floor(disparity.min(where=known, initial=np.inf))) - END_MARGIN
    high = float(np.ceil(disparity.max(where=known, initial=-np.inf))) + END_MARGIN
    disparity[~known] = low - 1
    height, width = truth.shape
    message = TYPES.types[DISPARITY_IMAGE](
        header=moment.header(), image=_image(disparity, moment), f=calibration.focal_length, t=calibration.baseline,
        valid_window=_ROI(0, 0, height, width, False), min_disparity=low, max_disparity=high,
        delta_d=float(np.spacing(np.float32(max(abs(low), abs(high))))))
    return _cdr(message, DISPARITY_IMAGE)


def _image(pixels: NDArray[Any], moment: Moment) -> Any:
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
    return TYPES.types[IMAGE](
        header=moment.header(), height=height, width=width, encoding=encoding_of(pixels),
        is_bigendian=int(sys.byteorder == 'big'), step=data.size // height, data=data)


def _cdr(message: Any, kind: str) -> bytes:
    return bytes(TYPES.serialize_cdr(message, kind))
