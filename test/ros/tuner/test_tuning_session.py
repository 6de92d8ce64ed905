"""The way back, presets, files, and two sets on one pair."""
import numpy as np
import pytest
from scenes import two_walls
from tuner_process import wait_until

from svdm_core import load_preset
from svdm_ros.node.parameter_set import NodeParameters
from svdm_ros.tuner import feeds, tuning_session
from svdm_ros.tuner.local_source import LocalSource
from svdm_ros.tuner.row_sources import StillRows
from svdm_ros.tuner.tuning_session import TuningSession

LEFT, RIGHT, _ = two_walls(60, 90, near=9, far=3, seed=1)


@pytest.fixture
def session(tmp_path):
    parameters = NodeParameters().replace({'num_disparities': 16})
    source = LocalSource('a, b', lambda: feeds.still_pair(LEFT, RIGHT, None), parameters, StillRows(), plays=False)
    source.start()
    wait_until(source.latest, 'a shot')
    yield TuningSession(source, tmp_path)
    source.stop()


def test_changes_are_taken_back_one_by_one(session, monkeypatch):
    monkeypatch.setattr(tuning_session, '_ONE_MOVE', 0.0)
    assert not session.can_undo and session.undo() == 'there is nothing to take back'
    for name, value in (('p2', 0.3), ('gradient', 'magnitude'), ('p2', 0.6)):
        assert session.move(name, value) == ''
    for p2, gradient in ((0.3, 'magnitude'), (0.3, 'horizontal'), (0.9, 'horizontal')):
        assert session.undo() == ''
        values = session.source.values()
        assert (values['p2'], values['gradient']) == (p2, gradient)
    assert not session.can_undo


def test_one_drag_is_taken_back_at_once(session):
    for value in (0.8, 0.7, 0.6, 0.5):
        session.move('p2', value)
    session.move('p1', 0.1)
    session.undo()
    session.undo()
    assert session.source.values()['p2'] == 0.9 and not session.can_undo


def test_a_refusal_has_its_reason_and_no_way_back(session):
    version = session.version
    assert session.move('p2', -1.0).startswith('p2 = -1.0 is not allowed')
    assert not session.can_undo and session.version > version and session.source.values()['p2'] == 0.9


def test_presets_are_loaded_marked_against_and_reset_to(session):
    assert session.load('fast') == '' and session.preset == 'fast'
    fast = load_preset('fast').as_dict()
    assert {name: session.source.values()[name] for name in fast} == fast
    session.move('p2', 0.1)
    assert session.base['p2'] == fast['p2'] != session.source.values()['p2']
    assert session.reset() == '' and session.source.values()['p2'] == fast['p2']
    session.undo()
    assert session.source.values()['p2'] == 0.1
    assert "there is no preset 'nothing'" in session.load('nothing') and session.preset == 'fast'


def test_what_is_saved_comes_back(session):
    session.move('sigma_s', 24.0)
    path = session.save('mine', replace=False)
    session.reset()
    assert session.load('mine.yaml') == '' and session.source.values()['sigma_s'] == 24.0
    with pytest.raises(ValueError, match='exists already'):
        session.save('mine', replace=False)
    assert path.is_file()


class Absent:
    """A source that knows nothing yet."""

    def values(self):
        return {}

    def hold(self):
        return None

    def change(self, _values):
        return 'not there'


def test_nothing_pretends_while_the_parameters_are_not_known(tmp_path):
    session = TuningSession(Absent(), tmp_path)
    path = tmp_path / 'good.yaml'
    path.write_text('/**:\n  ros__parameters:\n    alpha: 3.0\n')
    with pytest.raises(ValueError, match='the parameters are not known yet'):
        session.save('good', replace=True)
    assert 'alpha: 3.0' in path.read_text()
    for action in (session.reset, session.hold, lambda: session.load('fast')):
        assert 'the parameters are not known yet' in action()
    assert session.preset == 'default' and session.move('p2', 1.0) == 'not there'


def test_two_sets_are_compared_on_one_pair(session):
    assert session.take_held() == 'nothing is held'
    assert session.hold() == ''
    same = session.comparison.against(session.parameters())
    np.testing.assert_array_equal(same.first.disparity, same.second.disparity)
    assert same.different == 0 and same.first_figures['valid pixels'] == same.second_figures['valid pixels']
    session.move('p2', 0.05)
    other = session.comparison.against(session.parameters())
    assert other.first is same.first and other.different > 0
    assert session.take_held() == '' and session.source.values()['p2'] == 0.9
    session.move('roi', '0, 0, 5000, 20')
    with pytest.raises(ValueError, match='not within the image'):
        session.comparison.against(session.parameters())
    session.release()
    assert session.comparison is None
