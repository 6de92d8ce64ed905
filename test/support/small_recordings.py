"""A small recording, what is in it, and what is told of one."""
import numpy as np
import pytest
from recordings import contents, stereo

from svdm_ros.bags.reading.recording import RecordingError, open_recording


def tiny(index):
    return np.full((4, 8), index, np.uint8), np.full((4, 8), index + 1, np.uint8)


def few(count=6, **options):
    return list(stereo(count, pixels=tiny, **options))


def notes_of(path):
    with open_recording(path) as recording:
        return recording.notes


def refused(path):
    with pytest.raises(RecordingError) as caught:
        contents(path)
    assert '\n' not in str(caught.value)
    return str(caught.value)
