import cv2
import numpy as np
import pytest

from svdm_core.evaluation.pair_folders import find_pairs


@pytest.mark.parametrize(('pairs', 'most', 'count'), [(1, 50, 1), (50, 50, 50), (51, 50, 50), (51, 40, 40), (7, 3, 3)])
def test_as_many_pairs_as_are_asked_for_are_read_evenly_over_all(tmp_path, pairs, most, count):
    for side in ('left', 'right'):
        (tmp_path / side).mkdir()
        for number in range(pairs):
            cv2.imwrite(str(tmp_path / side / f'{number:03}.png'), np.full((1, 2), number, np.uint8))
    [camera] = find_pairs([tmp_path])
    read = [(int(left[0, 0]), int(right[0, 0])) for left, right in camera.read(most)]
    numbers = [number for number, _ in read]
    steps = np.diff([*numbers, pairs])
    assert read == [(number, number) for number in numbers] and len(numbers) == count and numbers[0] == 0
    assert steps.min() >= 1 and steps.max() - steps.min() <= 1
