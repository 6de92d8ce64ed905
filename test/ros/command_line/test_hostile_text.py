"""Text that would clear the screen, fill it, or forge a second line: by whatever door it comes, it is one line."""
import pytest
import yaml
from calibrations import MIDDLEBURY, euroc_documents, write_ros
from recordings import LEFT, ROS2, camera_info, image, scene, stamp, write

from svdm_core import MatcherParameters
from svdm_core.commands import cli
from svdm_ros.bags import images_to_bag, process_bag
from svdm_ros.bags.play.playback import chosen_topics
from svdm_ros.bags.reading.recording import open_recording
from svdm_ros.calibration.calibration_files import read_calibration
from svdm_ros.calibration.rectification import Rectification, unrectified_line
from svdm_ros.frames.compressed import decode
from svdm_ros.frames.image_conversion import image_to_array
from svdm_ros.node.declared_parameters import unknown_parameter_line
from svdm_ros.node.log_lines import Line
from svdm_ros.node.parameter_set import NodeParameters, node_parameter_table

EVIL = 'evil\x1b[2J\x1b]0;title\x07\n\r\u202eFATAL'
LONG = EVIL * 250_000  # 5 MB
LONGEST_REASON = 300


def with_model(model):
    info = camera_info('left', 0)
    info.distortion_model = model
    return info


def raw_image(encoding):
    message = image(scene(0)[0], 0)
    message.encoding = encoding
    return message


def bag_of(folder, topic):
    return write(folder / 'bag', [(topic, stamp(0), image(scene(0)[0], stamp(0)))])


def chosen(folder, names):
    with open_recording(bag_of(folder, f'{LEFT}{EVIL * 50}')) as recording:
        chosen_topics(recording.topics, names, with_clock=True)


def calibration(folder, text, name='calib.yaml'):
    path = folder / name
    path.write_text(text)
    read_calibration([path, path] if name.endswith('yaml') else [path], False)


def ros_calibration(folder, **change):
    files = write_ros(folder)
    document = yaml.safe_load(files[0].read_text()) | change
    files[0].write_text(yaml.safe_dump(document))
    read_calibration(files, False)


DOORS = {
    'encoding of an image': lambda _: image_to_array(raw_image(LONG)),
    'format of a compressed image': lambda _: decode(ROS2.types['sensor_msgs/msg/CompressedImage'](
        raw_image('').header, LONG, raw_image('').data)),
    'distortion_model of camera_info': lambda _: Rectification.of(with_model(LONG), 90, 60),
    'topics of a bag that is played': lambda folder: chosen(folder, ['/other']),
    'a topic that is asked for': lambda folder: chosen(folder, [LONG]),
    'model of a calibration': lambda folder: ros_calibration(folder, distortion_model=EVIL * 1000),
    'resolution of a calibration': lambda folder: calibration(
        folder, yaml.safe_dump(euroc_documents()[0] | {'resolution': EVIL * 1000})),
    'key of a calibration': lambda folder: calibration(folder, yaml.safe_dump({EVIL * 100: 1})),
    'anchor of a calibration': lambda folder: calibration(folder, f'a: &{"x" * 10**5} 1'),
    'no YAML': lambda folder: calibration(folder, f'a: [{EVIL * 100}'),
    'number of a calibration': lambda folder: calibration(
        folder, MIDDLEBURY.replace('baseline=200', f'baseline={EVIL.split()[0] * 100}'), 'c.txt'),
    'parameter': lambda _: MatcherParameters().replace(**{LONG: 1}),
}


@pytest.mark.parametrize('door', DOORS)
def test_whatever_the_door_the_message_is_one_line(tmp_path, door):
    with pytest.raises(ValueError) as refused:
        DOORS[door](tmp_path)
    told = str(refused.value)
    assert told.isprintable() and len(told) < 900, told[:2000]


@pytest.mark.parametrize('info', node_parameter_table(), ids=lambda info: info.name)
def test_the_reason_of_a_refused_parameter_is_short(info):
    for value in (LONG, 10**5000, -10**5000, float('nan'), [LONG], LONG.encode(), [10**30] * 10**5, None):
        with pytest.raises(ValueError) as refused:
            NodeParameters().replace({info.name: value})
        reason = str(refused.value)
        assert reason.isprintable() and len(reason) <= LONGEST_REASON and info.name in reason, reason


def test_names_of_parameters_and_topics_in_the_log_of_the_node():
    assert unknown_parameter_line(LONG).isprintable() and len(unknown_parameter_line(LONG)) < LONGEST_REASON
    info = camera_info('left', 0)
    info.d[0] = 0.1
    told = unrectified_line(info, LONG)
    assert told.isprintable() and len(told) < 600
    text = Line('any', f'Traceback:\n  {LONG}').text.split('\n')
    assert text[0] == 'Traceback:' and all(map(str.isprintable, text))


def refused_by(command, arguments, capsys):
    assert command(arguments) == 2
    told = capsys.readouterr()
    assert told.out == ''
    [line] = told.err.splitlines()
    assert line.isprintable() and r'\x1b[2J' in line
    return line


def test_hostile_names_of_files_are_one_line_of_the_commands(tmp_path, capsys):
    evil = tmp_path / EVIL
    out = str(tmp_path / 'out')
    refused_by(process_bag.main, [str(evil), out], capsys)
    refused_by(images_to_bag.main, [str(evil), str(evil), '--calib', str(evil), out], capsys)
    refused_by(cli.main, ['match', str(evil), str(evil), '-o', str(tmp_path / 'a.pfm')], capsys)
    evil.write_text('no bag')
    refused_by(process_bag.main, [str(evil), out], capsys)
    refused_by(process_bag.main, [str(evil), out, '--preset', EVIL], capsys)


def test_hostile_topics_of_a_bag_are_one_line(tmp_path, capsys):
    bag = bag_of(tmp_path, f'{LEFT}{EVIL}')
    refused_by(process_bag.main, [str(bag), str(tmp_path / 'out')], capsys)
