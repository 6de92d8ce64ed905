"""process_bag --jobs: nobody else can reach its processes, and whatever ends one of them costs nothing."""
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import dying_workers
import psutil
import pytest
from recordings import contents, stereo, write
from scenes import two_walls

from svdm_ros.bags.process.local_workers import process_locally
from svdm_ros.bags.process.processing import Job
from svdm_ros.bags.process_bag import main

SMALL = ('--set', 'num_disparities=16', 'median_scope=all', 'w_p=81')
"""Few disparities, and a median that makes each pair last long enough to be interrupted."""

PAIRS = 80
COMMAND = '''
import sys
from svdm_ros.bags import process_bag
from svdm_ros.bags.process import process_command

def teller(_bars, name):
    return lambda done, total: print(f'{name} {done}\\n', end='', flush=True)

process_command.Bars.teller = teller
sys.exit(process_bag.main(sys.argv[1:]))
'''


@pytest.fixture(scope='module')
def bags(tmp_path_factory):
    folder = tmp_path_factory.mktemp('input')
    pictures = [two_walls(seed=2 * seed)[:2] for seed in range(4)]
    return [write(folder / name, stereo(PAIRS, pixels=lambda index: pictures[index % 4])) for name in 'ab']


@pytest.fixture(scope='module')
def expected(bags, tmp_path_factory):
    output = tmp_path_factory.mktemp('expected') / 'a'
    assert main([str(bags[0]), str(output), *SMALL]) == 0
    return contents(output)


@pytest.fixture
def begin(bags, tmp_path):
    """Starts the command on two recordings, and returns when a pair of each is done; it, and its processes."""
    started = []

    def begun():
        command = [sys.executable, '-c', COMMAND, *map(str, bags), str(tmp_path / 'out'), '--jobs', '2', *SMALL]
        process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
                                   start_new_session=True)
        started.append(process)
        names = set()
        while len(names) < 2:
            line = process.stdout.readline()
            assert line, process.communicate()
            name, *rest = line.split()  # the line of a bag that is finished before the other one begins has more words
            names |= {name} if len(rest) == 1 and int(rest[0]) else set()
        return process, psutil.Process(process.pid).children(recursive=True)

    yield begun
    for process in started:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


def run_again(bags, output, expected):
    for bag in bags:
        if not (output / bag.name).exists():
            assert main([str(bag), str(output / bag.name), *SMALL]) == 0
    assert [contents(output / name) for name in 'ab'] == [expected] * 2
    assert sorted(path.name for path in output.iterdir()) == ['a', 'b']


def listening(processes):
    """The sockets of processes that take connections or datagrams: protocol and place."""
    own = set()
    for process in processes:
        for file in Path(f'/proc/{process.pid}/fd').iterdir():
            try:
                own.add(os.readlink(file))
            except FileNotFoundError:  # closed meanwhile
                continue
    found = []
    for protocol, states in (('tcp', ('0A',)), ('tcp6', ('0A',)), ('udp', ('07',)), ('udp6', ('07',))):
        for line in Path(f'/proc/net/{protocol}').read_text().splitlines()[1:]:
            fields = line.split()
            if fields[3] in states and f'socket:[{fields[9]}]' in own:
                found.append((protocol, fields[1]))
    for line in Path('/proc/net/unix').read_text().splitlines()[1:]:
        fields = line.split()
        if int(fields[3], 16) & 0x10000 and f'socket:[{fields[6]}]' in own:
            found.append(('unix', fields[7:]))
    return found


def test_no_process_listens_so_that_nobody_can_connect(begin):
    process, children = begin()
    assert len(children) >= 3  # two at work, and the one by which Python tidies up
    tree = [psutil.Process(process.pid), *children]
    assert listening(tree) == []
    assert [one for member in tree for one in member.net_connections('inet')] == []


def test_a_port_would_have_been_seen():
    own = [psutil.Process()]
    before = listening(own)
    with socket.create_server(('127.0.0.1', 0)) as server:
        assert [found for found in listening(own) if found not in before] == [
            ('tcp', f'0100007F:{server.getsockname()[1]:04X}')]


@pytest.mark.parametrize(('number', 'to_all'), [(signal.SIGINT, True), (signal.SIGTERM, False)])
def test_a_signal_ends_all_with_a_line_and_the_same_command_goes_on(bags, begin, tmp_path, expected, number, to_all):
    """As Ctrl-C in a terminal, which every process gets, and as `kill`, which only the command gets."""
    process, children = begin()
    (os.killpg if to_all else os.kill)(process.pid, number)
    told = process.communicate(timeout=60)[1]
    assert process.returncode == 130
    assert told.splitlines() == ['process_bag: interrupted; what is done is kept, the same command goes on from there']
    assert not psutil.wait_procs(children, 20)[1]
    for name in 'ab':  # on a busy machine one may have come to its end meanwhile
        [place] = (tmp_path / 'out').glob(f'{name}*')
        assert set() < set(contents(place)) <= set(expected)
    run_again(bags, tmp_path / 'out', expected)


def test_a_process_that_is_killed_is_begun_again(bags, begin, tmp_path, expected):
    process, children = begin()
    worker = max(children, key=lambda child: child.memory_info().rss)
    worker.kill()
    _, told = process.communicate(timeout=60)
    assert (process.returncode, told) == (0, '')
    assert [contents(tmp_path / 'out' / name) for name in 'ab'] == [expected] * 2


def test_when_the_command_is_killed_its_processes_end_and_the_same_command_goes_on(bags, begin, tmp_path, expected):
    process, children = begin()
    process.kill()
    assert not psutil.wait_procs(children, 20)[1]
    run_again(bags, tmp_path / 'out', expected)


@pytest.mark.parametrize(('serve', 'told'), [
    (dying_workers.killed, 'killed by SIGKILL, 3 times'), (dying_workers.failing, 'ended with exit code 3')])
def test_a_process_that_ends_whatever_is_done_is_told_and_ends_no_other(bags, tmp_path, monkeypatch, serve, told):
    monkeypatch.setattr('svdm_ros.bags.process.local_workers._serve', serve)
    jobs = [Job(bag, tmp_path / bag.name) for bag in bags]
    outcomes = list(process_locally(jobs, 2, lambda _name: lambda done, total: None))
    assert sorted(outcome.name for outcome in outcomes) == [str(bag) for bag in bags]
    assert all(told in outcome.problem and outcome.exit_code == 2 for outcome in outcomes)
