"""What the pictures show of known maps."""
import base64

import cv2
import numpy as np
import pytest

from svdm_ros.tuner.pictures import (
    as_uri,
    confidence_picture,
    difference_picture,
    different_share,
    disparity_picture,
    error_picture,
    left_picture,
)
from svdm_ros.tuner.shot import Shot


def shot(disparity, known=None, confidence=None, truth=None, left=None):
    disparity = np.array(disparity, np.float32)
    known = np.ones(disparity.shape, bool) if known is None else np.array(known)
    left = np.full(disparity.shape, 90, np.uint8) if left is None else left
    return Shot(1, left, disparity, known, known, confidence, (0.0, 10.0), truth)


def test_unknown_is_black_near_is_red_far_is_blue():
    picture = disparity_picture(shot([[0, 10, 5]], [[True, True, False]]))
    blue, red, black = picture[0].astype(int)
    assert blue[0] > blue[2] and red[2] > red[0] and not black.any()


def test_errors_are_white_where_right_red_where_too_near_blue_where_too_far():
    truth = np.array([[5, 5, 5, np.inf]], np.float32)
    right, near, far, unknown = error_picture(shot([[5, 9, 1, 5]], truth=truth))[0].astype(int)
    assert right.tolist() == [255, 255, 255] and near[2] == 255 > near[0] and far[0] == 255 > far[2]
    assert unknown.tolist() == [0, 0, 0]
    assert not error_picture(shot([[1, 2]])).any()


def test_what_differs_is_marked_and_counted():
    first, second = shot([[5, 5, 5, 5]]), shot([[5.5, 7, 3, 5]], [[True, True, True, False]])
    same, nearer, farther, lost = difference_picture(first, second)[0].astype(int)
    assert len(set(same)) == 1 and nearer[2] > nearer[0] and farther[0] > farther[2] and set(lost) == {60}
    assert different_share(first, second) == 75.0 and different_share(first, first) == 0
    assert different_share(first, shot([[1, 2]])) is None
    assert difference_picture(first, shot([[1, 2]])).shape == (1, 2, 3)


def test_confidence_and_images_of_sixteen_bits():
    assert confidence_picture(shot([[1, 1]], confidence=np.array([[0, 1]], np.float32))).tolist() == [[0, 255]]
    assert not confidence_picture(shot([[1, 1]])).any()
    wide = left_picture(shot(np.zeros((2, 50)), left=np.linspace(1000, 1400, 100).reshape(2, 50).astype(np.uint16)))
    assert wide.dtype == np.uint8 and wide.min() == 0 and wide.max() == 255


@pytest.mark.parametrize('shape', [(20, 30), (20, 30, 3), (500, 2000, 3)])
def test_pictures_are_jpeg_and_no_wider_than_960(shape):
    uri = as_uri(np.full(shape, 77, np.uint8))
    kind, _, data = uri.partition(',')
    assert kind == 'data:image/jpeg;base64'
    decoded = cv2.imdecode(np.frombuffer(base64.b64decode(data), np.uint8), cv2.IMREAD_COLOR)
    assert decoded.shape[1] == min(shape[1], 960)
