"""Nothing of the user's is removed or written over: process_bag works in a folder it made, and refuses any other."""
import os
import shutil
import socket

import pytest
import yaml
from recordings import contents, stereo, write
from scene_files import files_of

from svdm_ros.bags.process import processing
from svdm_ros.bags.process_bag import main
from svdm_ros.bags.reading.metadata import ROOT
from svdm_ros.bags.writing import output_place, partial_bag, partial_folder
from svdm_ros.bags.writing.partial_folder import locked_folder

pytest_plugins = ['process_bag_fixtures']

SMALL = ('--set', 'num_disparities=16')


def state_of(folder):
    """Every path below a folder with what is there: the bytes of a file, the target of a link, or the kind."""
    return {path: path.read_bytes() if path.is_file() and not path.is_symlink() else
            os.readlink(path) if path.is_symlink() else path.lstat().st_mode
            for path in sorted(folder.rglob('*'))}


@pytest.fixture(scope='module')
def begun(bag, tmp_path_factory):
    """A partial bag of two of the five pairs, as an interrupted run leaves it."""
    folder = tmp_path_factory.mktemp('begun')
    tell, seen = [], processing.process

    def interrupted(job, _tell):
        def stop(done, _total):
            tell.append(done)
            if done == 2:
                raise KeyboardInterrupt
        return seen(job, stop)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('svdm_ros.bags.process.process_command.process', interrupted)
        assert main([str(bag), str(folder / 'out'), *SMALL]) == 130
    assert tell[-1] == 2
    return folder / 'out.partial'


@pytest.fixture
def partial(begun, tmp_path):
    """A copy of it for a test of its own."""
    return shutil.copytree(begun, tmp_path / 'out.partial')


# What is there already


def make_folder(path):
    (path / 'sub').mkdir(parents=True)
    (path / 'sub' / 'a').write_text('mine')


def make_link(path):
    make_folder(path.with_name('elsewhere'))
    path.symlink_to(path.with_name('elsewhere'))


def make_lock(path):
    path.mkdir()
    (path / '.lock').write_text('mine')


def make_linked_lock(path):
    path.mkdir()
    path.with_name('precious').write_text('mine')
    (path / '.lock').symlink_to(path.with_name('precious'))


def make_lock_linked_to_a_mark(path):
    path.mkdir()
    with locked_folder(path.with_name('other')):
        (path / '.lock').symlink_to(path.with_name('other.partial') / '.lock')


def make_pipe_as_lock(path):
    path.mkdir()
    os.mkfifo(path / '.lock')


def make_socket(path):
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


FOREIGN = {
    'a folder': make_folder,
    'an empty folder': lambda path: path.mkdir(),
    'a link to a folder': make_link,
    'a link to nothing': lambda path: path.symlink_to('nowhere'),
    'a file': lambda path: path.write_text('mine'),
    'a pipe': os.mkfifo,
    'a socket': make_socket,
    'another lock': make_lock,
    'a lock that is a link': make_linked_lock,
    'a lock that is a link to a mark': make_lock_linked_to_a_mark,
    'a lock that is a pipe': make_pipe_as_lock,
}


@pytest.mark.parametrize('force', [(), ('--force',)])
@pytest.mark.parametrize('kind', FOREIGN)
def test_what_process_bag_did_not_make_is_refused_and_stays(bag, run, tmp_path, monkeypatch, kind, force):
    monkeypatch.chdir(tmp_path)  # the path of a socket must be short
    FOREIGN[kind](tmp_path / 'out.partial')
    before = state_of(tmp_path)
    told = run(bag, *force, code=2)
    assert 'out.partial was not made by process_bag (' in told
    assert 'is left as it is, with --force too: move it away, or name another output' in told
    assert state_of(tmp_path) == before


def test_the_same_holds_for_each_of_several_outputs(bag, tmp_path, capsys):
    """In a pattern that matches one recording, which runs as several do."""
    make_folder(tmp_path / 'out' / 'bag.partial')
    before = state_of(tmp_path)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr('svdm_ros.bags.process.process_command._run_many', lambda jobs, _options: [
            processing.process(job) for job in jobs])
        assert main([f'{bag.parent}/*', str(tmp_path / 'out'), *SMALL]) == 2
    assert 'bag.partial was not made by process_bag' in capsys.readouterr().err
    assert state_of(tmp_path) == before


def add_file(partial):
    (partial / 'notes.txt').write_text('mine')


def add_folder(partial):
    (partial / 'in_work_segment').mkdir()
    (partial / 'in_work_segment' / 'notes.txt').write_text('mine')


def add_link(partial):
    make_folder(partial.with_name('mine'))
    (partial / 'preview').symlink_to(partial.with_name('mine'))


def add_linked_summary(partial):
    partial.with_name('mine').write_text('mine')
    (partial / 'summary.json').symlink_to(partial.with_name('mine'))


def add_picture(partial):
    (partial / 'preview').mkdir()
    (partial / 'preview' / 'holiday.png').write_text('mine')


@pytest.mark.parametrize('force', [(), ('--force',)])
@pytest.mark.parametrize('add', [add_file, add_folder, add_link, add_linked_summary, add_picture])
def test_what_came_into_the_folder_is_refused_and_stays(bag, run, partial, add, force):
    add(partial)
    before = state_of(partial.parent)
    told = run(bag, '--preview', 'png', *force, code=2)
    assert 'out.partial holds ' in told and 'which process_bag did not write' in told
    assert state_of(partial.parent) == before


def test_what_comes_into_the_folder_of_a_run_that_gives_nothing_stays(run, tmp_path, monkeypatch):
    discard = partial_bag.PartialBag.discard

    def discarded(bag):
        add_file(tmp_path / 'out.partial')
        discard(bag)

    monkeypatch.setattr(partial_bag.PartialBag, 'discard', discarded)
    entries = [(topic, time_ns + (topic == '/cam/right/image_rect'), message) for topic, time_ns, message in stereo(1)]
    entries[2][2].header.stamp.nanosec += 5
    run(write(tmp_path / 'bag', entries), code=2)
    assert (tmp_path / 'out.partial' / 'notes.txt').read_text() == 'mine'


def test_the_mark_is_readable_and_goes_with_the_folder(bag, run, partial, tmp_path):
    assert (partial / '.lock').read_text().startswith('process_bag of svdm_ros: a bag under construction')
    run(bag)
    assert sorted(path.name for path in (tmp_path / 'out').iterdir()) == ['metadata.yaml', 'out_0.mcap', 'summary.json']


# The output itself


def test_an_output_that_appears_meanwhile_is_not_replaced(bag, run, tmp_path, monkeypatch):
    put = partial_bag.put_in_place

    def appeared(*arguments):
        make_folder(tmp_path / 'out')
        put(*arguments)

    with monkeypatch.context() as patch:
        patch.setattr(partial_bag, 'put_in_place', appeared)
        told = run(bag, code=1)
    assert 'out exists already' in told
    assert (tmp_path / 'out' / 'sub' / 'a').read_text() == 'mine'
    shutil.rmtree(tmp_path / 'out')
    run(bag)  # the partial bag was complete
    assert len(contents(tmp_path / 'out')) == 15


@pytest.mark.parametrize('name', ['notes.txt', 'sub/notes.txt', 'preview/holiday.png'])
def test_force_replaces_no_folder_that_holds_anything_beside_a_bag(bag, run, tmp_path, name):
    mine = write(tmp_path / 'out', stereo(1)) / name
    mine.parent.mkdir(exist_ok=True)
    mine.write_text('mine')
    before = state_of(tmp_path)
    told = run(bag, '--force', code=2)
    assert f'out holds {name.partition("/")[0]}, which is no part of a bag' in told
    assert state_of(tmp_path) == before


def test_force_replaces_a_link_to_a_bag_and_leaves_the_bag(bag, run, tmp_path):
    elsewhere = write(tmp_path / 'elsewhere', stereo(1))
    before = files_of(elsewhere)
    (tmp_path / 'out').symlink_to(elsewhere)
    run(bag, '--force')
    assert files_of(elsewhere) == before
    assert not (tmp_path / 'out').is_symlink() and len(contents(tmp_path / 'out')) == 15
    assert sorted(path.name for path in tmp_path.iterdir()) == ['elsewhere', 'out']


def test_an_input_within_the_output_is_refused(bag, run, tmp_path):
    output = shutil.copytree(bag, tmp_path / 'out')
    before = state_of(tmp_path)
    assert 'lies in the output' in run(output / 'bag.mcap', '--force', code=2)
    assert state_of(tmp_path) == before


def test_a_bag_that_cannot_be_replaced_gets_its_name_back(tmp_path):
    earlier, new = write(tmp_path / 'out', stereo(1)), tmp_path / 'nowhere'
    before = state_of(tmp_path)
    with pytest.raises(FileNotFoundError):
        output_place.put_in_place(new, earlier, force=True)
    assert state_of(tmp_path) == before


# Damage


def change_metadata(**values):
    def change(partial):
        file = partial / 'metadata.yaml'
        content = yaml.safe_load(file.read_text())
        content[ROOT].update(values)
        file.write_text(yaml.safe_dump(content))
    return change


def change_state(text):
    return change_metadata(custom_data={'svdm_ros': text})


def write_metadata(data):
    return lambda partial: (partial / 'metadata.yaml').write_bytes(data)


def segment(partial):
    [file] = partial.glob('*.segment.mcap')
    return file


def cut_off(partial):
    file = segment(partial)
    file.write_bytes(file.read_bytes()[:-100])


def randomise(partial):
    segment(partial).write_bytes(bytes(range(256)) * 40)


DAMAGE = {
    'empty': (write_metadata(b''), 'metadata.yaml'),
    'random bytes': (write_metadata(bytes(range(256))), 'metadata.yaml'),
    'no YAML': (write_metadata(b'a: [1'), 'metadata.yaml'),
    'a list': (write_metadata(b'- 1'), 'metadata.yaml'),
    'another root': (write_metadata(b'a: 1'), 'metadata.yaml'),
    'nothing below the root': (write_metadata(f'{ROOT}: {{}}'.encode()), 'metadata.yaml'),
    'files of another shape': (change_metadata(files=7), 'metadata.yaml'),
    'no files': (change_metadata(files=[], relative_file_paths=[]), 'metadata.yaml'),
    'files elsewhere': (change_metadata(files=[{'path': '../bag/bag.mcap'}], relative_file_paths=['../bag/bag.mcap']),
                        'metadata.yaml'),
    'topics of another shape': (change_metadata(topics_with_message_count=[7]), 'metadata.yaml'),
    'state that is no JSON': (change_state('{'), 'metadata.yaml'),
    'state that is a list': (change_state('[]'), 'metadata.yaml'),
    'state without settings': (change_state('{}'), 'metadata.yaml'),
    'state that is deep': (change_state('[' * 10**5), 'metadata.yaml'),
    'no state at all': (change_metadata(custom_data=None), '.finished.json'),
    'custom data of another shape': (change_metadata(custom_data=[1]), 'metadata.yaml'),
    'a file that is missing': (lambda partial: segment(partial).unlink(), '.segment.mcap'),
    'a file that is cut off': (cut_off, 'out.partial'),
    'a file of random bytes': (randomise, 'out.partial'),
}


@pytest.mark.parametrize('kind', DAMAGE)
def test_damage_is_one_line_that_names_the_file_and_force_begins_anew(bag, run, partial, kind):
    damage, file = DAMAGE[kind]
    damage(partial)
    before = state_of(partial.parent)
    told = run(bag, code=2)
    assert f'{file}' in told and 'damaged (' in told
    assert '--force removes what process_bag wrote in this folder and begins anew' in told
    assert len(told) < 700
    assert state_of(partial.parent) == before


@pytest.mark.parametrize('state', [{'done': 'x'}, {'foo': 1}, {'dropped': 7}, {'dropped': {'a': 'b'}}, {'done': -1},
                                   {'reasons': {'a': 1}}, {'disparities': True}, {'done': None}, {'as_dict': 1}])
def test_counts_of_another_shape_are_damage_too(bag, run, partial, state):
    metadata = yaml.safe_load((partial / 'metadata.yaml').read_text())[ROOT]
    stored = yaml.safe_load(metadata['custom_data']['svdm_ros'])
    change_state(partial_bag.json.dumps({**stored, 'state': state}))(partial)
    told = run(bag, code=2)
    assert 'metadata.yaml: damaged (' in told and '--force' in told


@pytest.mark.parametrize('kind', ['random bytes', 'a file that is cut off'])
def test_force_begins_anew_after_damage(bag, run, partial, kind):
    DAMAGE[kind][0](partial)
    run(bag, '--force')
    assert len(contents(partial.with_name('out'))) == 15
    assert not partial.exists()


def test_the_folder_is_refused_while_another_process_has_just_finished_it(tmp_path, monkeypatch):
    """Its lock is opened before, and held after, the other one has given the bag its name."""
    with locked_folder(tmp_path / 'out'):
        pass

    def finished_meanwhile(_lock, _how):
        (tmp_path / 'out.partial').rename(tmp_path / 'out')

    monkeypatch.setattr(partial_folder.fcntl, 'flock', finished_meanwhile)
    with pytest.raises(ValueError, match='has just finished it'), locked_folder(tmp_path / 'out'):
        pass
