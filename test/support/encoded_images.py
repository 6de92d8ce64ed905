"""A grey scene as each encoding of sensor_msgs/Image stores it."""
import numpy as np

PLANAR = ('nv12', 'nv21')
_CHANNELS = {'8UC3': 3, 'bgr': 3, 'rgb': 3, '8UC4': 4, 'bgra': 4, 'rgba': 4}


def as_stored(grey, encoding):
    """(rows, W) or (rows, W, channels) of the type that the encoding has; `grey` is (H, W) uint8, of even sides."""
    if encoding == '32FC1':
        return (grey / 255).astype(np.float32)
    if encoding in PLANAR:
        return np.vstack([grey, np.full((len(grey) // 2, grey.shape[1]), 128, np.uint8)])
    if encoding in ('uyvy', 'yuv422', 'yuyv', 'yuv422_yuy2'):
        pair = [grey, np.full_like(grey, 128)]
        return np.dstack(pair if encoding.startswith('yuyv') or encoding.endswith('yuy2') else pair[::-1])
    if '16' in encoding:
        grey = grey.astype(np.uint16) * 257
    channels = _CHANNELS.get(encoding.removesuffix('16').removesuffix('8'), 1)
    return grey if channels == 1 else np.repeat(grey[:, :, None], channels, 2)
