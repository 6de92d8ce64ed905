"""What the command measures of the filters, on a wall whose disparity is known."""
import re

import cv2
import numpy as np
from scene_files import SIZE, truth_off, write_middlebury

from svdm_ros.benchmark.filters import _flicker, main


def rows(text, title):
    """The numbers of each row of the table whose heading contains `title`, by its first cell."""
    [table] = [part for part in text.split('\n\n') if title in part.split('\n')[0]]
    cells = [[cell.strip() for cell in line.strip('|').split('|')] for line in table.splitlines()[2:]]
    return {tuple(cell for cell in line if not re.fullmatch(r'[\d.]+', cell)) or line[0]:
            [float(cell) for cell in line if re.fullmatch(r'[\d.]+', cell)] for line in cells}


def test_the_tables_tell_of_the_scenes_and_of_the_sequence(tmp_path, capsys):
    write_middlebury(tmp_path / 'scenes' / 'one', truth=truth_off(visible=20, occluded=0))
    for side in ('left', 'right'):
        (tmp_path / side).mkdir()
        for number in range(2):
            cv2.imwrite(str(tmp_path / side / f'{number}.png'), np.full(SIZE, 99, np.uint8))
    assert main([str(tmp_path / 'scenes'), '--street', str(tmp_path)]) == 0
    text = capsys.readouterr().out
    kept = rows(text, 'kept')
    assert kept['none',][0] == 100 and all(values[0] <= 100 for values in kept.values())
    of_threshold = [kept[f'`confidence_threshold: {least}`',][0] for least in (0.1, 0.2, 0.3, 0.5)]
    assert of_threshold == sorted(of_threshold, reverse=True) and of_threshold[-1] < of_threshold[0]
    assert 1 < kept['none',][2] < 3  # one column of 84 is off by 20 px
    assert len(rows(text, 'right image')) == 4 and len(rows(text, 'ms at')) == 4
    standing, street = rows(text, 'stands'), rows(text, 'street')
    assert len(standing) == 3 and [values[1:] for values in street.values()] == [[0, 0]] * 3


def test_flicker_is_of_what_is_steady_before_the_filter():
    raw = [np.float32([[1, 1, 5]]), np.float32([[1.5, 1, 9]])]
    assert _flicker(raw, raw) == 0.25
    assert _flicker(raw, [raw[0], np.float32([[1.25, 1, 9]])]) == 0.125


def test_a_folder_without_scenes_is_one_line(tmp_path, capsys):
    assert main([str(tmp_path)]) == 2
    assert re.fullmatch(r'filter_benchmark: .*no scene in it.*\n', capsys.readouterr().err)
