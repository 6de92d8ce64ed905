"""Recordings of two raw cameras that look at planes."""
import numpy as np
import planes
import recordings
from recordings import stamp, write

RAW_SIZE, RAW_FOCAL, RAW_BASELINE = (188, 120), 109.0, 0.11


def raw_infos():
    """Of two cameras with a distortion, turned a little."""
    lens, k = [-0.28, 0.07, 0.0002, 1e-5], [114.5, 114.2, 92.0, 62.0]
    return {side: planes.camera_info(RAW_SIZE, 'plumb_bob', lens, k, turn, (RAW_FOCAL, 92.5, 61.2, shift))
            for side, turn, shift in (('left', (0.012, -0.025, 0.008), 0.0),
                                      ('right', (-0.01, 0.02, -0.015), -RAW_FOCAL * RAW_BASELINE))}


def raw_recording(path, with_infos, together=False):
    entries = []
    for index in range(2):
        views = []
        for side, info in raw_infos().items():
            message = recordings.camera_info(side, stamp(index))
            for name in ('width', 'height', 'distortion_model'):
                setattr(message, name, getattr(info, name))
            for name in 'dkrp':
                setattr(message, name, np.array(getattr(info, name), np.float64).ravel())
            entries += [(f'/{side}/camera_info', stamp(index), message)] * with_infos
            views.append(planes.render(info, raw=True)[0])
        images = {'/image_raw': np.hstack(views)} if together else dict(
            zip(('/left/image_raw', '/right/image_raw'), views, strict=True))
        entries += [(topic, stamp(index), recordings.image(pixels, stamp(index))) for topic, pixels in images.items()]
    return write(path, entries)
