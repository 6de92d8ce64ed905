"""Recordings for the tests, written with rosbags."""
import hashlib
from pathlib import Path

import cv2
import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore
from scenes import two_walls

from svdm_ros.bags.reading.recording import open_recording

ROS1, ROS2 = get_typestore(Stores.ROS1_NOETIC), get_typestore(Stores.ROS2_JAZZY)
MS = 1_000_000
BEGIN = 1_700_000_000_000_000_000
PERIOD = 100 * MS
LEFT, RIGHT = '/cam/left/image_rect', '/cam/right/image_rect'
LEFT_INFO, RIGHT_INFO = '/cam/left/camera_info', '/cam/right/camera_info'
F, T, OFFSET = 400.0, 0.5, 2.0
SMALL = ('--set', 'num_disparities=16')  # for `process_bag`


def stamp(index):
    return BEGIN + index * PERIOD


def header(stamp_ns, frame='left_optical', types=ROS2):
    time = types.types['builtin_interfaces/msg/Time'](*divmod(stamp_ns, 10**9))
    kind = types.types['std_msgs/msg/Header']
    return kind(7, time, frame) if types is ROS1 else kind(time, frame)


def image(pixels, stamp_ns, encoding=None, types=ROS2):
    height, width = pixels.shape[:2]
    data = np.ascontiguousarray(pixels).view(np.uint8).ravel()
    encoding = encoding or ('mono8' if pixels.ndim == 2 else 'bgr8')
    return types.types['sensor_msgs/msg/Image'](
        header(stamp_ns, types=types), height, width, encoding, 0, data.size // height, data)


def compressed(pixels, stamp_ns, suffix='png', original='mono8'):
    data = cv2.imencode(f'.{suffix}', pixels)[1].ravel()
    return ROS2.types['sensor_msgs/msg/CompressedImage'](header(stamp_ns), f'{original}; {suffix} compressed', data)


def camera_info(side, stamp_ns, size=(90, 60), focal=F, types=ROS2):
    """Principal points OFFSET apart, so that what is not shifted shows."""
    cx, tx = (45.0 + OFFSET, 0.0) if side == 'left' else (45.0, -focal * T)
    p = np.array([focal, 0, cx, tx, 0, focal, 30, 0, 0, 0, 1, 0], float)
    roi = types.types['sensor_msgs/msg/RegionOfInterest'](0, 0, 0, 0, False)
    return types.types['sensor_msgs/msg/CameraInfo'](
        header(stamp_ns, types=types), size[1], size[0], 'plumb_bob', np.zeros(5), p.reshape(3, 4)[:, :3].ravel(),
        np.eye(3).ravel(), p, 0, 0, roi)


def scene(index):
    """A pair of 90x60 px that differs from one index to the next."""
    return two_walls(seed=10 + 2 * index)[:2]


def stereo(count, pixels=scene, infos=True, types=ROS2):
    """(topic, time, message) of `count` pairs; each message is recorded some ms after its stamp."""
    for index in range(count):
        now = stamp(index)
        for late, (side, topic, info) in enumerate((('left', LEFT, LEFT_INFO), ('right', RIGHT, RIGHT_INFO))):
            yield topic, now + (3 + late) * MS, image(pixels(index)[late], now, types=types)
            if infos:
                yield info, now + (5 + late) * MS, camera_info(side, now, types=types)


def write(path, messages, storage='mcap', compression=None):
    """A rosbag2 folder. compression: None, 'message', 'file' or 'storage' (the chunks of mcap), all zstd."""
    writer = Writer(path, version=9, storage_plugin=StoragePlugin[storage.upper()])
    if compression:
        writer.set_compression(CompressionMode[compression.upper()], CompressionFormat.ZSTD)
    return _fill(writer, messages, ROS2, lambda message, kind: ROS2.serialize_cdr(message, kind), path)


def write_ros1(path, messages):
    return _fill(Ros1Writer(path), messages, ROS1, lambda message, kind: ROS1.serialize_ros1(message, kind), path)


def _fill(writer, messages, types, serialize, path):
    connections = {}
    with writer:
        for topic, time_ns, message in messages:
            kind = message.__msgtype__
            if topic not in connections:
                connections[topic] = writer.add_connection(topic, kind, typestore=types)
            writer.write(connections[topic], time_ns, serialize(message, kind))
    return path


def contents(path):
    """(topic, time, digest of the bytes) of every message in order; a whole one each, as it is deserialized too."""
    with open_recording(Path(path)) as recording:
        found = []
        for message in recording.messages():
            recording.deserialize(message)
            found.append((message.topic, message.time_ns, hashlib.sha256(message.data).hexdigest()))
        return found


def messages_of(path, topic):
    """The messages of one topic, deserialized, with their times."""
    with open_recording(Path(path)) as recording:
        return [(message.time_ns, recording.deserialize(message)) for message in recording.messages([topic])]
