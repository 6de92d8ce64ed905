"""A kill at each step between the last message and the end: the same command again gives the bytes of a whole run."""
import json
import shutil
import signal
import subprocess
import sys

import pytest
from checkout import CHECKOUT
from recordings import contents, stamp, stereo, write

OF_THIS_RUN = ('seconds', 'pairs_per_second', 'matcher_ms', 'matched_in_this_run')


@pytest.fixture(scope='module')
def start():
    """Runs process_bag, to its end or to a step after the last message; the exit code, and what was printed."""
    server = subprocess.Popen([sys.executable, CHECKOUT / 'test' / 'support' / 'killed_process_bag.py'],
                              stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)

    def started(arguments, log, kill_at=-1, begin='last message'):
        request = [[str(argument) for argument in arguments], str(log), kill_at, begin]
        print(json.dumps(request), file=server.stdin, flush=True)
        return int(server.stdout.readline()), log.read_text()
    yield started
    server.communicate(timeout=30)


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return write(tmp_path_factory.mktemp('input') / 'bag', stereo(2))


def files_of(folder):
    """Every file in a folder with its bytes; the summary without what depends on the run."""
    found = {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob('*') if path.is_file()}
    summary = json.loads(found.pop('summary.json'))
    return found, {name: value for name, value in summary.items() if name not in OF_THIS_RUN}


def swept(start, tmp_path, arguments, prepare, begin):
    """Kill at one step after the other until there is none left; gives the step, and what runs the command again."""
    log = tmp_path / 'log'
    for kill_at in range(200):
        prepare()
        code, told = start(arguments, log, kill_at, begin)
        if code != -signal.SIGKILL:
            assert code == 0, told
            assert kill_at > 6
            return
        yield kill_at, lambda: start(arguments, log)
    raise AssertionError('it never ended')


def test_after_a_kill_at_any_step_the_same_command_ends_with_the_same_bytes(bag, start, tmp_path):
    output, partial = tmp_path / 'out', tmp_path / 'out.partial'
    arguments = [bag, output, '--preview', 'png']
    code, told = start(arguments, tmp_path / 'log')
    assert code == 0, told
    expected, messages = files_of(output), contents(output)
    assert len(messages) == 6 and sorted(expected[0]) == [
        'metadata.yaml', 'out_0.mcap', *(f'preview/{stamp(index)}.png' for index in range(2))]
    finished = 0

    def clear():
        if output.exists():
            output.rename(tmp_path / f'before_{len(list(tmp_path.iterdir()))}')

    for _, again in swept(start, tmp_path, arguments, clear, 'last message'):
        if partial.exists():
            assert not output.exists()
            assert set(contents(partial)) <= set(messages)
            code, told = again()
            assert code == 0, told
            assert '2 disparities of 2 pairs' in told
        else:  # it has its name: what was left is to tidy up
            code, told = again()
            assert (code, 'out exists already' in told) == (2, True)
            finished += 1
        assert files_of(output) == expected
        assert not partial.exists()
    assert finished >= 1
    assert not [path.name for path in tmp_path.iterdir() if path.name.startswith('.')]


def test_a_bag_that_is_being_replaced_is_whole_somewhere_after_a_kill_at_any_step(bag, start, tmp_path):
    output, log = tmp_path / 'out', tmp_path / 'log'
    assert start([bag, output, '--duration', '0.1'], log)[0] == 0
    shutil.copytree(output, tmp_path / 'earlier')
    earlier = files_of(output)
    assert start([bag, tmp_path / 'whole'], log)[0] == 0
    expected = files_of(tmp_path / 'whole')
    # The name of a bag is in the names of its files.
    new = {name.replace('whole', 'out'): data for name, data in expected[0].items() if name != 'metadata.yaml'}

    def restore():
        if output.exists():
            shutil.rmtree(output)
        shutil.copytree(tmp_path / 'earlier', output)

    def is_new(folder):
        found = files_of(folder)[0]
        return all(found.get(name) == data for name, data in new.items())

    seen = set()
    for _, again in swept(start, tmp_path, [bag, output, '--force'], restore, 'renaming'):
        aside = [place for place in tmp_path.glob('out.replaced.*/out') if (place / 'summary.json').exists()]
        seen.add((output.exists() and files_of(output) == earlier, bool(aside)))
        assert output.exists() or any(files_of(place) == earlier for place in aside), 'the earlier bag is lost'
        code, told = again()
        assert code == 0, told
        assert is_new(output)
        assert not (tmp_path / 'out.partial').exists()
        for place in tmp_path.glob('out.replaced.*'):
            place.rename(tmp_path / f'kept_{len(list(tmp_path.iterdir()))}')
    assert {(True, False), (False, True)} <= seen
