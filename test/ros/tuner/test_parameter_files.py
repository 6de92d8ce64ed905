"""What is saved and loaded, and what is left alone."""
import pytest
import yaml

from svdm_core.presets import preset_names
from svdm_ros.command_line.parameters import node_parameters
from svdm_ros.node.parameter_set import NodeParameters, node_parameter_table
from svdm_ros.tuner.parameter_files import ParameterFiles

VALUES = {info.name: info.default for info in node_parameter_table()}


def test_what_is_saved_is_what_a_node_and_a_command_load(tmp_path):
    files = ParameterFiles(tmp_path)
    wanted = {**VALUES, 'p2': 1.2, 'num_disparities': 128, 'speckle_size': 100, 'gradient': 'magnitude',
              'subpixel': False}
    path = files.write('mine', wanted, replace=False)
    assert path == tmp_path / 'mine.yaml' and files.names() == [*preset_names(), 'mine.yaml']
    assert files.read('mine.yaml') == wanted
    assert node_parameters(path) == NodeParameters().replace(wanted)
    assert set(yaml.safe_load(path.read_text())['/**']['ros__parameters']) == {
        'p2', 'num_disparities', 'speckle_size', 'gradient', 'subpixel'}


def test_presets_are_read_by_name(tmp_path):
    assert ParameterFiles(tmp_path).read('fast')['aggregation'] == 'box'


@pytest.mark.parametrize('name', ['', '../a', '/etc/a', 'a/b', '.hidden', 'a\n', 'a b', 'x' * 200, 'a;b', '-a', 'a\\b'])
def test_a_name_is_a_name_and_no_way_out_of_the_folder(tmp_path, name):
    with pytest.raises(ValueError, match=r'the name .* is not allowed') as error:
        ParameterFiles(tmp_path).write(name, VALUES, replace=True)
    assert '\n' not in str(error.value) and not list(tmp_path.iterdir())


def test_nothing_is_overwritten_unasked_and_nothing_else_ever(tmp_path):
    files = ParameterFiles(tmp_path)
    path = files.write('mine', VALUES, replace=False)
    before = path.read_text()
    with pytest.raises(ValueError, match='exists already: choose another name, or allow it to be replaced'):
        files.write('mine', {**VALUES, 'p2': 2.0}, replace=False)
    assert path.read_text() == before
    files.write('mine', {**VALUES, 'p2': 2.0}, replace=True)
    assert 'p2: 2.0' in path.read_text()
    other, target = tmp_path / 'other.yaml', tmp_path / 'target'
    other.write_text('precious: 1\n')
    target.write_text('/**:\n  ros__parameters: {}\n')
    (tmp_path / 'link.yaml').symlink_to(target)
    for name in ('other', 'link'):
        with pytest.raises(ValueError, match='exists and is no parameter file'):
            files.write(name, VALUES, replace=True)
    assert other.read_text() == 'precious: 1\n' and target.read_text() == '/**:\n  ros__parameters: {}\n'
    assert files.names()[-1] == 'mine.yaml'


def test_a_damaged_file_is_told(tmp_path):
    (tmp_path / 'bad.yaml').write_text('/**:\n  ros__parameters:\n    p2: many\n')
    (tmp_path / 'odd.yaml').write_text('/**:\n  ros__parameters:\n    pee2: 1\n')
    files = ParameterFiles(tmp_path)
    with pytest.raises(ValueError, match="p2 = 'many' is not allowed"):
        files.read('bad.yaml')
    with pytest.raises(ValueError, match="unknown parameter 'pee2'"):
        files.read('odd.yaml')
    with pytest.raises(ValueError, match=r"there is no preset '\.\./x'"):
        files.read('../x')


def test_a_folder_that_cannot_be_written_is_told(tmp_path):
    with pytest.raises(ValueError, match='there is no folder'):
        ParameterFiles(tmp_path / 'gone').write('a', VALUES, replace=False)
