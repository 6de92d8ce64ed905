"""The tracker of a live camera: it finds, follows, and lets go of a field."""
import numpy as np
import pytest
from row_scenes import HEIGHT, SCENES, SEARCH, WIDTH, difference, pair
from scenes import noise

from svdm_core import RowAlignment, RowTracker

START = (0.2, -0.1, 0.3, 0.4, 0.1, -0.1)
NAMES = list(SCENES)


def field(constant=0.0, scale=1.0):
    return RowAlignment(tuple(scale * np.array(START) + np.array([constant, 0, 0, 0, 0, 0])), WIDTH, HEIGHT)


def looks(tracker, wanted, number, first=0):
    """Shown so many pairs with the field: how often the alignment changed."""
    return sum(tracker.look(*pair(NAMES[seed % len(NAMES)], wanted, seed)) for seed in range(first, first + number))


def test_it_finds_a_field_and_keeps_it_to_the_object():
    tracker = RowTracker(*SEARCH)
    assert tracker.alignment is None
    looks(tracker, field(), 3)
    found = tracker.alignment
    assert difference(found, field()) <= 0.08
    assert looks(tracker, field(), 9, 3) <= 1
    assert difference(tracker.alignment, field()) <= 0.05


def test_it_follows_a_drift_of_half_a_pixel_in_100_frames_within_20():
    tracker = RowTracker(*SEARCH)
    looks(tracker, field(), 5)
    late = []
    for frame in range(0, 100, 1):
        tracker.look(*pair(NAMES[frame % 3], field(0.005 * frame), frame))
        late.append(difference(tracker.alignment, field(0.005 * frame)))
    assert max(late) <= 20 * 0.005
    looks(tracker, field(0.5), 20)
    assert difference(tracker.alignment, field(0.5)) <= 0.05


@pytest.mark.parametrize('jump', [0.6, 3.0])
def test_a_knock_is_followed_also_beyond_what_can_be_measured(jump):
    tracker = RowTracker(*SEARCH)
    looks(tracker, field(jump / 2), 4)
    assert difference(tracker.alignment, field(jump / 2)) <= 0.08
    looks(tracker, field(-jump / 2), 30)
    assert difference(tracker.alignment, field(-jump / 2)) <= 0.08


def test_rows_that_have_come_to_be_aligned_are_left_alone():
    tracker = RowTracker(*SEARCH)
    looks(tracker, field(), 4)
    looks(tracker, RowAlignment.identity(WIDTH, HEIGHT), 20)
    assert tracker.alignment.is_identity


def test_aligned_rows_dark_frames_and_other_scenes_change_nothing():
    tracker = RowTracker(*SEARCH)
    assert looks(tracker, RowAlignment.identity(WIDTH, HEIGHT), 6) == 0 and tracker.alignment is None
    looks(tracker, field(), 20)
    found = tracker.alignment
    assert difference(found, field()) <= 0.08
    for seed in range(20):
        assert not tracker.look(np.zeros((HEIGHT, WIDTH), np.uint8), np.zeros((HEIGHT, WIDTH), np.uint8))
        assert not tracker.look(noise(HEIGHT, WIDTH, seed=seed), noise(HEIGHT, WIDTH, seed=seed + 100))
    assert tracker.alignment is found


def test_the_same_looks_give_the_same_and_another_size_begins_anew():
    trackers = RowTracker(*SEARCH), RowTracker(*SEARCH)
    for tracker in trackers:
        looks(tracker, field(), 4)
    assert trackers[0].alignment == trackers[1].alignment is not None
    assert not trackers[0].look(noise(40, 50), noise(40, 50)) and trackers[0].alignment is None
    trackers[1].reset()
    assert trackers[1].alignment is None
    with pytest.raises(ValueError, match='left image 50 x 40 px and right image 60 x 40 px must have the same size'):
        trackers[1].look(noise(40, 50), noise(40, 60))
