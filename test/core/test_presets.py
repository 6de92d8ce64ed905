from pathlib import Path

import pytest
import yaml

from svdm_core import MatcherParameters, load_preset, parameter_table, preset_names
from svdm_core.presets import preset_folder, preset_text

# All that a preset settles, named by it or left to the defaults.
NAMES = (
    'gradient', 'alpha', 'tau_ad', 'tau_gm', 'guide_blur', 'census_weight', 'aggregation', 'sigma_tree', 'd_y',
    'subpixel', 'p1', 'p2', 'p2_edge', 'paths', 'tau_lr', 'median_scope', 'median_guide', 'w_p', 'sigma_s',
    'sigma_c', 'final_median', 'uniqueness', 'filling', 'plane_fit',
)
PRESETS = {
    'accurate': (
        'horizontal', 10.7, 0.04, 2 / 255, 1, 0.5, 'tree', 0.015, 255, True, 0.07, 0.9, 20.0, 4, 1.0,
        'filled', 'image', 41, 24.0, 0.08, 3, 0.09, 'far', True),
    'default': (
        'horizontal', 10.7, 0.04, 2 / 255, 1, 0.5, 'tree', 0.015, 255, True, 0.07, 0.9, 20.0, 4, 1.0,
        'filled', 'image', 23, 14.0, 0.06, 3, 0.09, 'far', True),
    'fast': (
        'horizontal', 0.0, 0.0, 2 / 255, 1, 0.3, 'box', 0.1, 255, True, 0.05, 0.7, 8.0, 3, 1.0, 'filled',
        'image', 11, 8.0, 0.1, 5, 0.1, 'far', False),
    'paper': (
        'magnitude', 10.7, 7 / 255, 2 / 255, 3, 0.0, 'tree', 0.1, 255, False, 0.0, 0.0, 0.0, 4, 1.0, 'all',
        'image', 31, 15.8, 0.175, 1, 0.0, 'scanline', False),
    'paper_start': (
        'magnitude', 1.0, 7 / 255, 2 / 255, 3, 0.0, 'tree', 0.1, 255, False, 0.0, 0.0, 0.0, 4, 1.0, 'all',
        'image', 11, 1.0, 0.1, 1, 0.0, 'scanline', False),
}
OF_RANGE_AND_ROWS = {'accurate': ('pair', 1), 'default': ('pair', 2), 'fast': ('pair', 2), 'paper': ('full', 2),
                     'paper_start': ('full', 2)}  # intensity_range, right_rows


def write(folder, text):
    path = folder / 'mine.yaml'
    path.write_text(text)
    return path


def test_default_is_the_default():
    assert load_preset('default') == MatcherParameters()


@pytest.mark.parametrize('name', preset_names())
def test_a_preset_is_what_it_was_whatever_becomes_of_the_defaults(name):
    values = load_preset(name).as_dict()
    assert set(values) == {*NAMES, 'intensity_range', 'right_rows', 'min_disparity', 'num_disparities'}
    assert (values['intensity_range'], values['right_rows']) == OF_RANGE_AND_ROWS[name]
    assert tuple(values[parameter] for parameter in NAMES) == PRESETS[name]


def test_the_papers_presets_are_its_start_and_its_optimum():
    start, optimum = load_preset('paper_start'), load_preset('paper')
    tuned = ('alpha', 'sigma_s', 'sigma_c', 'w_p')
    assert [getattr(start, name) for name in tuned] == [1.0, 1.0, 0.1, 11]
    assert [getattr(optimum, name) for name in tuned] == [10.7, 15.8, 0.175, 31]
    assert start.replace(**{name: getattr(optimum, name) for name in tuned}) == optimum


@pytest.mark.parametrize('name', preset_names())
def test_a_preset_says_when_to_take_it_and_sets_what_differs_from_the_defaults(name):
    text = (preset_folder() / f'{name}.yaml').read_text()
    assert text.startswith('# Take this one ')
    values = yaml.safe_load(text)['/**']['ros__parameters']
    known = {info.name: info for info in parameter_table()}
    assert set(values) <= set(known) - {'min_disparity', 'num_disparities'}
    assert [name for name, value in values.items() if value == known[name].default] == []
    # rclpy refuses 1 where a double is declared, so a preset must write 1.0
    assert {name: type(value) for name, value in values.items()} == {name: known[name].type for name in values}


@pytest.mark.parametrize(('text', 'reason'), [
    ('/**:\n  ros__parameters:\n    alpah: 1.0\n', "unknown parameter 'alpah': did you mean alpha"),
    ('/**:\n  ros__parameters:\n    w_p: 4\n', 'w_p = 4 is not allowed'),
    ('alpha: 1.0\n', 'not a ROS parameter file'),
    ('/**:\n  ros__parameters: 3\n', 'not a ROS parameter file'),
    ('', 'not a ROS parameter file'),
    ('a: [1\n', 'no YAML'),
    ('/**:\n  ros__parameters:\n    1: 2\n', 'the parameter name 1 is not allowed: it must be a string'),
    ('/**:\n  ros__parameters:\n    alpha: 2.0\n    on: 2\n', 'the parameter name True is not allowed'),
])
def test_what_is_wrong_with_a_file_is_told_in_one_line(tmp_path, text, reason):
    path = write(tmp_path, text)
    with pytest.raises(ValueError) as refusal:
        load_preset(path)
    assert str(refusal.value).startswith(f'{path}: ') and reason in str(refusal.value)
    assert '\n' not in str(refusal.value)


@pytest.mark.parametrize('changes', [{}, {'alpha': 2.5, 'aggregation': 'box', 'num_disparities': 32}])
def test_a_preset_that_was_written_is_read_again(tmp_path, changes):
    path = write(tmp_path, preset_text(MatcherParameters(**changes), 'Take this one'))
    search_range = {'num_disparities': MatcherParameters().num_disparities}  # is the camera's
    assert load_preset(path) == MatcherParameters(**{**changes, **search_range})
    assert list(yaml.safe_load(path.read_text())['/**']['ros__parameters']) == list(changes)[:2]


def test_a_file_of_ones_own_is_read(tmp_path):
    path = write(tmp_path, '/disparity_node:\n  ros__parameters:\n    alpha: 2.5\n    subpixel: false\n')
    assert load_preset(path) == MatcherParameters(alpha=2.5, subpixel=False)


@pytest.mark.parametrize('kind', [FileNotFoundError, ValueError])
@pytest.mark.parametrize('missing', ['papre', Path('nowhere') / 'mine.yaml'])
def test_what_is_missing_is_named_with_what_there_is(kind, missing):
    with pytest.raises(kind) as refusal:
        load_preset(missing)
    assert str(refusal.value) == (
        f"no preset '{missing}': there are {', '.join(preset_names())}, or give a .yaml file")


def test_a_file_is_read_and_missed_where_no_presets_are_installed(tmp_path, monkeypatch):
    monkeypatch.setattr('svdm_core.presets.__file__', str(tmp_path / 'lib' / 'svdm_core' / 'presets.py'))
    assert load_preset(write(tmp_path, '/**:\n  ros__parameters:\n    alpha: 2.5\n')).alpha == 2.5
    with pytest.raises(ValueError, match=r"no preset 'nowhere\.yaml': none is installed"):
        load_preset('nowhere.yaml')
    with pytest.raises(ValueError, match='no presets installed'):
        load_preset('paper')
