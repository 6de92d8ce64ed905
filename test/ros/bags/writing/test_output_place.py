"""images_to_bag replaces bags only, whole, and never what it reads or what came meanwhile."""
import cv2
import numpy as np
import pytest
from calibrations import write_kitti
from recordings import stereo, write
from scene_files import files_of

from svdm_ros.bags import images_to_bag
from svdm_ros.bags.writing import new_bag


@pytest.fixture
def pairs(tmp_path):
    """Two pairs and a calibration."""
    for side in ('left', 'right'):
        (tmp_path / side).mkdir()
        for name in ('0.png', '1.png'):
            cv2.imwrite(str(tmp_path / side / name), np.full((32, 48), 7, np.uint8))
    write_kitti(tmp_path, 'odometry')
    return tmp_path


def convert(folder, output, *options, left='left'):
    return images_to_bag.main([str(folder / left), str(folder / 'right'), '--calib', str(folder / 'calib.txt'),
                               str(output), *options])


def refused(capsys):
    """The line it was refused with."""
    [line] = capsys.readouterr().err.splitlines()
    assert line.startswith('images_to_bag: ')
    return line


def test_images_within_the_output_are_refused(pairs, capsys):
    output = write(pairs / 'bag', stereo(1))
    (pairs / 'left').rename(output / 'left')
    before = files_of(pairs)
    assert convert(pairs, output, '--force', left='bag/left') == 2
    assert 'is read and lies in the output' in refused(capsys)
    assert files_of(pairs) == before


def test_a_bag_with_anything_beside_it_is_not_replaced(pairs, capsys):
    output = write(pairs / 'bag', stereo(1))
    (output / 'notes.txt').write_text('mine')
    before = files_of(pairs)
    assert convert(pairs, output, '--force') == 2
    assert 'bag holds notes.txt, which is no part of a bag' in refused(capsys)
    assert files_of(pairs) == before


@pytest.mark.parametrize(('options', 'told'), [((), 'bag exists already'), (('--force',), 'bag is no bag')])
def test_what_appears_meanwhile_stays(pairs, capsys, monkeypatch, options, told):
    put = new_bag.put_in_place

    def appeared(*arguments):
        (pairs / 'bag').mkdir()
        (pairs / 'bag' / 'a').write_text('mine')
        put(*arguments)

    monkeypatch.setattr(new_bag, 'put_in_place', appeared)
    assert convert(pairs, pairs / 'bag', *options) == 2
    assert told in refused(capsys)
    assert files_of(pairs / 'bag') == {pairs / 'bag' / 'a': b'mine'}
    assert sorted(path.name for path in pairs.iterdir()) == ['bag', 'calib.txt', 'left', 'right']
