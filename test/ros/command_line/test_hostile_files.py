"""Files of users that are hostile or of another kind: refused in one line, at once; nothing hangs, nothing blows up."""
import ast
import os
import re
import signal
from pathlib import Path

import pytest
from calibrations import MIDDLEBURY, euroc_documents, write_kitti
from recordings import contents, stereo, write

import svdm_core
import svdm_ros
from svdm_core import load_preset
from svdm_core.files.user_files import METADATA, SETTINGS, RefusedFileError, parse_yaml, read_text
from svdm_core.tuning.store import FigureStore
from svdm_ros.bags import images_to_bag, process_bag
from svdm_ros.bags.images.ground_truth import read_truth
from svdm_ros.bags.images.image_files import find_pairs, read_pixels
from svdm_ros.bags.reading.recording import RecordingError, open_recording
from svdm_ros.calibration.calibration_files import read_calibration
from svdm_ros.node.process import run
from svdm_ros.node.usage import check_parameter_files

LENGTHS = (10**5, 10**6)
LONGEST_LINE = 700
"""Of a message: a value of 200 characters, a path, and what to do."""


class HungError(Exception):
    pass


@pytest.fixture
def at_once():
    """The test may compute for a second, and last ten where it waits for something."""
    def hung(_number, _frame):
        raise HungError

    timers = {signal.SIGPROF: (signal.ITIMER_PROF, 1), signal.SIGALRM: (signal.ITIMER_REAL, 10)}
    earlier = {number: signal.signal(number, hung) for number in timers}
    for timer, seconds in timers.values():
        signal.setitimer(timer, seconds)
    yield
    for number, (timer, _) in timers.items():
        signal.setitimer(timer, 0)
        signal.signal(number, earlier[number])


def line_of(call, *arguments):
    """What is refused with, one line that is not long."""
    with pytest.raises(ValueError) as refused:
        call(*arguments)
    line = str(refused.value)
    assert '\n' not in line and len(line) < LONGEST_LINE, line
    return line


# Text


def repeated(text, length):
    return text * (length // len(text))


HOSTILE = {
    'thirteen numbers': lambda n: '\n'.join(['1.5 ' * 12 + '1' * (n // 2 - 50)] * 2),
    'digits twice': lambda n: '\n'.join(['1' * (n // 2 - 5)] * 2),
    'digits and a letter twice': lambda n: '\n'.join([f'{"1" * (n // 2 - 5)}x'] * 2),
    'numbers twice': lambda n: '\n'.join([repeated('1 ', n // 2 - 5)] * 2),
    'digits': lambda n: f'cam0={"1" * (n - 30)}x',
    'a long number': lambda n: MIDDLEBURY.replace('baseline=200', f'baseline={"1" * (n - 500)}x'),
    'spaces': lambda n: MIDDLEBURY.replace('baseline=200', f'baseline={" " * (n - 500)}x'),
    'spaces before a name': lambda n: f'{" " * (n - 5)}cam0',
    'empty lines': lambda n: '\n' * n,
    'a long name': lambda n: 'P' * n,
    'points': lambda n: f'P0: {repeated("1.", n - 10)}\nP1: 1',
}
HOSTILE_YAML = {
    'brackets': lambda n: '[' * n,
    'braces': lambda n: '{' * n,
    'dashes': lambda n: repeated('- ', n),
    'values': lambda n: f'T_BS: [{repeated("1,", n - 20)}1]',
    'a long word': lambda n: f'T_BS: {"x" * (n - 10)}',
    'a long number': lambda n: f'T_BS: {"1" * (n - 10)}',
    'sexagesimal': lambda n: f'T_BS: {repeated("1:", n - 10)}1',
    'sexagesimal by its tag': lambda n: f'T_BS: !!int "{repeated("1:", n - 20)}1"',
    'version and spaces': lambda n: f'%YAML:1.0{" " * (n - 20)}x',
    'a long model': lambda n: f'{{T_BS: 1, resolution: [7, 7], distortion_model: "{repeated("no ", n - 80)}"}}',
    'exclamation marks': lambda n: '!' * n,
}


@pytest.mark.parametrize('length', LENGTHS)
@pytest.mark.parametrize('kind', HOSTILE)
def test_hostile_text_is_refused_within_a_second(tmp_path, at_once, kind, length):
    path = tmp_path / 'calib.txt'
    path.write_text(HOSTILE[kind](length))
    assert str(path) in line_of(read_calibration, [path], False)


@pytest.mark.parametrize('length', LENGTHS)
@pytest.mark.parametrize('kind', HOSTILE_YAML)
def test_hostile_yaml_is_refused_within_a_second(tmp_path, at_once, kind, length):
    path = tmp_path / 'left.yaml'
    path.write_text(HOSTILE_YAML[kind](length))
    assert str(path) in line_of(read_calibration, [path, path], False)


def test_thirteen_numbers_are_counted(tmp_path, at_once):
    path = tmp_path / 'calib.txt'
    path.write_text('\n'.join([' '.join(['7.215377e+02'] * 13)] * 2))
    assert 'line 1 has 13 numbers, a projection matrix has 12' in line_of(read_calibration, [path], False)


@pytest.mark.parametrize('value', ['1e999', 'nan', '1e300', '1_0', '0x10', '1e', '-', 'inf', '\u0661'])
def test_what_is_no_number_is_named(tmp_path, value):
    path = tmp_path / 'calib.txt'
    path.write_text(MIDDLEBURY.replace('baseline=200', f'baseline={value}'))
    assert f'baseline is {value!r}, it must be a number' in line_of(read_calibration, [path], False)


@pytest.mark.parametrize('value', ['0', '800.5', '65537', '1e11'])
def test_a_size_is_whole_pixels(tmp_path, value):
    path = tmp_path / 'calib.txt'
    path.write_text(MIDDLEBURY.replace('width=800', f'width={value}'))
    assert 'it must be whole px from 1 to 65536' in line_of(read_calibration, [path], False)


def test_numbers_of_yaml_beyond_any_float_are_refused(tmp_path):
    path = tmp_path / 'left.yaml'
    document = dict(euroc_documents()[0], intrinsics=[10**400] * 4)
    path.write_text(str(document))
    assert 'intrinsics of the left camera must be 4 numbers' in line_of(read_calibration, [path, path], False)


def test_no_regular_expression_has_two_quantifiers_without_bound():
    """Two of them, nested or side by side, can take a line in more ways than there is time."""
    found = []
    for source in [path for package in (svdm_core, svdm_ros) for path in Path(package.__path__[0]).rglob('*.py')]:
        for node in ast.walk(ast.parse(source.read_text())):
            if isinstance(node, ast.Call) and ast.unparse(node.func).startswith('re.'):
                pattern = ast.literal_eval(node.args[0])
                pattern = pattern if isinstance(pattern, str) else pattern.decode('latin-1')
                found.append(pattern)
                assert len(re.findall(r'[*+]|,\}', pattern)) <= 1, f'{source.name}: {pattern}'
    assert found


# YAML


def bomb(levels=9):
    """Ten to the power of nine words, in a few lines."""
    lines = ['a0: &a0 [x, x, x, x, x, x, x, x, x, x]']
    lines += [f'a{n}: &a{n} [{", ".join([f"*a{n - 1}"] * 10)}]' for n in range(1, levels)]
    return '\n'.join(lines)


@pytest.mark.parametrize('text', [bomb(), 'a: &b 1', 'a: &b\n- *b', 'a: *b'])
def test_anchors_and_aliases_are_refused(at_once, text):
    assert 'anchor or alias' in line_of(parse_yaml, text, SETTINGS)


@pytest.mark.parametrize('text', [
    'a: 2001-99-99', f'a: {"1" * 999}:77', 'a: !!python/object:os.system 1', '\0', '!!int ""', '!!bool 7',
    '!!timestamp x', '!!float x', '!!binary \u00e9', '!!opencv-matrix [1]', '!!set [1]', 'a: b: c', '? [1]\n: 2',
    '--- 1\n--- 2'])
def test_what_yaml_does_not_build_is_one_line(text):
    try:
        parse_yaml(text, SETTINGS)
    except RefusedFileError as error:
        assert '\n' not in str(error)
    else:
        assert text.startswith(('a: 1', '!!set'))


def test_nesting_is_limited_before_anything_is_built():
    assert parse_yaml('[' * 32 + ']' * 32, SETTINGS)
    assert 'more than 32 levels' in line_of(parse_yaml, '[' * 33 + ']' * 33, SETTINGS)


def test_sizes_are_limited(tmp_path):
    path = tmp_path / 'calib.txt'
    path.write_text('#' * (2**20 + 1))
    assert 'at most 1048576 are allowed' in line_of(read_calibration, [path], False)
    path.write_text('#' * 2**20)
    assert 'none of the calibrations known' in line_of(read_calibration, [path], False)
    with path.open('r+b') as file:
        file.truncate(2**40)  # nothing of it is on the disk
    assert 'at most 1073741824' in line_of(read_pixels, path)


def test_a_value_is_shown_up_to_200_characters(tmp_path):
    path = tmp_path / 'calib.txt'
    path.write_text(MIDDLEBURY.replace('baseline=200', f'baseline={"x" * 5000}'))
    line = line_of(read_calibration, [path], False)
    assert 'x' * 200 in line and 'x' * 201 not in line and '5000 characters' in line


# Pipes, devices, folders


def make_pipe(path):
    os.mkfifo(path)


def make_device(path):
    path.symlink_to('/dev/zero')


KINDS = {'a pipe': make_pipe, 'a device': make_device, 'a folder': Path.mkdir}


@pytest.mark.parametrize('kind', KINDS)
def test_what_is_no_file_is_refused_where_a_file_is_read(tmp_path, at_once, kind):
    readers = {
        'calib.txt': lambda path: read_calibration([path], False),
        'left.yaml': lambda path: read_calibration([path, path], False),
        'a.png': read_pixels,
        'truth.pfm': lambda path: read_truth(path, (1, 1)),
        'truth.png': lambda path: read_truth(path, (1, 1)),
        'a.txt': lambda path: read_text(path, METADATA),
    }
    for name, read in readers.items():
        KINDS[kind](tmp_path / name)
        assert f'{name} is {kind}' in line_of(read, tmp_path / name)


@pytest.mark.parametrize('kind', KINDS)
def test_what_is_no_file_is_refused_as_parameters_of_the_node_preset_and_storage(tmp_path, at_once, kind):
    path = tmp_path / 'my.yaml'
    KINDS[kind](path)
    assert f'my.yaml is {kind}' in line_of(check_parameter_files, ['x', '--ros-args', '--params-file', str(path)])
    assert f'my.yaml is {kind}' in line_of(load_preset, path)
    assert f'my.yaml is {kind}' in line_of(FigureStore, path)


def test_the_node_looks_at_its_parameter_files_before_rcl_opens_them(tmp_path, capfd):
    path = tmp_path / 'my.yaml'
    make_pipe(path)
    assert run(None, ['x', '--ros-args', '--params-file', str(path)]) == 2
    assert f'not started: {path} is a pipe (FIFO): give a regular file' in capfd.readouterr().err


def test_parameter_files_of_the_node_are_left_to_rcl_otherwise(tmp_path):
    check_parameter_files(['x', '--params-file', str(tmp_path / 'none.yaml'), '--params-file'])


@pytest.mark.parametrize('text', [bomb(), '[' * 10**5, 'a: !!bool 7', '\ud800', '\0'])
def test_hostile_presets_are_refused(tmp_path, at_once, text):
    path = tmp_path / 'my.yaml'
    path.write_text(text, errors='surrogatepass')
    assert f'{path}: ' in line_of(load_preset, path)


@pytest.mark.parametrize('kind', ['a pipe', 'a device'])
def test_what_is_no_file_is_refused_as_image_times_or_folder(tmp_path, at_once, kind):
    for side in ('left', 'right'):
        (tmp_path / side).mkdir()
        (tmp_path / side / '1.png').write_bytes(b'')
    KINDS[kind](tmp_path / 'times.txt')
    assert f'times.txt is {kind}' in line_of(find_pairs, tmp_path / 'left', tmp_path / 'right', None)
    assert f'times.txt is {kind}' in line_of(find_pairs, tmp_path / 'times.txt', tmp_path / 'right', None)
    KINDS[kind](tmp_path / 'left' / '0.png')
    assert f'0.png is {kind}' in line_of(read_pixels, tmp_path / 'left' / '0.png')


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return write(tmp_path_factory.mktemp('input') / 'bag', stereo(2))


def opened(path):
    with open_recording(path):
        return None


@pytest.mark.parametrize('kind', ['a pipe', 'a device'])
@pytest.mark.parametrize('name', ['bag.mcap', 'bag.db3', 'bag.bag', 'bag.mcap.zstd', 'bag'])
def test_a_recording_that_is_no_file_is_refused(tmp_path, at_once, kind, name):
    KINDS[kind](tmp_path / name)
    assert f'{name} is {kind}' in line_of(opened, tmp_path / name)


@pytest.mark.parametrize('kind', KINDS)
@pytest.mark.parametrize('with_metadata', [True, False])
def test_a_file_of_a_bag_that_is_none_is_refused(bag, tmp_path, at_once, kind, with_metadata):
    if with_metadata:
        (tmp_path / 'metadata.yaml').write_bytes((bag / 'metadata.yaml').read_bytes())
    KINDS[kind](tmp_path / 'bag.mcap')
    with pytest.raises(RecordingError):
        opened(tmp_path)
    assert f'bag.mcap is {kind}' in line_of(opened, tmp_path)


@pytest.mark.parametrize('kind', KINDS)
def test_metadata_that_is_no_file_is_refused(tmp_path, at_once, kind):
    KINDS[kind](tmp_path / 'metadata.yaml')
    assert f'metadata.yaml is {kind}' in line_of(opened, tmp_path)


@pytest.mark.parametrize('text', [
    bomb(), '[' * 10**5, f'a: {"1:" * 10**5}', '{}', 'rosbag2_bagfile_information: 7', '- 1', ''])
def test_hostile_metadata_is_refused(tmp_path, at_once, text):
    (tmp_path / 'metadata.yaml').write_text(text)
    assert f'{tmp_path / "metadata.yaml"}: ' in line_of(opened, tmp_path)


def test_hostile_yaml_within_the_yaml_of_metadata_is_refused(bag, tmp_path, at_once):
    indented = bomb().replace('\n', '\n' + 12 * ' ')
    (tmp_path / 'metadata.yaml').write_text(
        'rosbag2_bagfile_information:\n  relative_file_paths: [x]\n  topics_with_message_count:\n'
        f'    - topic_metadata:\n        offered_qos_profiles: |\n            {indented}\n')
    assert 'offered_qos_profiles: the YAML has an anchor' in line_of(opened, tmp_path)


def test_the_metadata_of_rosbags_is_taken(bag):
    assert len(contents(bag)) == 8


@pytest.mark.parametrize('kind', KINDS)
def test_the_commands_refuse_a_calibration_that_is_no_file(bag, tmp_path, capsys, kind):
    KINDS[kind](tmp_path / 'calib.txt')
    KINDS[kind](tmp_path / 'node.yaml')
    for side in ('left', 'right'):
        (tmp_path / side).mkdir()
    calib, out = str(tmp_path / 'calib.txt'), str(tmp_path / 'out')
    assert process_bag.main([str(bag), out, '--calib', calib]) == 2
    assert process_bag.main([str(bag), out, '--params', str(tmp_path / 'node.yaml')]) == 2
    assert [f' is {kind}' in line for line in capsys.readouterr().err.splitlines()] == [True, True]
    write_kitti(tmp_path / 'left', 'odometry')
    text = str(tmp_path / 'left' / 'calib.txt')
    assert images_to_bag.main([text, str(tmp_path / 'right'), out, '--calib', calib]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 1
    assert not os.path.lexists(out)


def test_a_parameter_file_with_a_bomb_is_refused(bag, tmp_path, capsys):
    file = tmp_path / 'node.yaml'
    file.write_text(bomb())
    assert process_bag.main([str(bag), str(tmp_path / 'out'), '--params', str(file)]) == 2
    assert 'anchor or alias' in capsys.readouterr().err
