"""Many recordings: each for itself, a broken one named, those that are done skipped; also on a Dask cluster."""
import contextlib
import shutil
import subprocess
import sys
import time

import pytest
from recordings import contents, stereo, write

from svdm_ros.bags.process_bag import main

SMALL = ('--set', 'num_disparities=16')


@pytest.fixture(scope='module')
def folder(tmp_path_factory):
    """Two recordings, one of them of another length, and between them one that is cut off."""
    folder = tmp_path_factory.mktemp('many')
    for name, count in (('a', 4), ('b', 4), ('c', 6)):
        write(folder / name, stereo(count))
    broken = folder / 'b' / 'b.mcap'
    broken.write_bytes(broken.read_bytes()[:30_000])
    return folder


@pytest.fixture(scope='module')
def expected(folder, tmp_path_factory):
    """What one run a recording gives."""
    output = tmp_path_factory.mktemp('expected')
    for name in 'ac':
        assert main([str(folder / name), str(output / name), *SMALL]) == 0
    return {name: contents(output / name) for name in 'ac'}


def process(*arguments):
    command = [sys.executable, '-m', 'svdm_ros.bags.process_bag', *map(str, arguments), *SMALL]
    return subprocess.run(command, capture_output=True, text=True, timeout=100)


def check(run, folder, output, expected):
    """Two outputs, one named failure."""
    assert run.returncode == 1, run.stderr
    assert run.stderr.splitlines()[-1].startswith(f'process_bag: {folder / "b"}: the file is cut off')
    assert run.stderr.count('process_bag:') == 1
    assert sorted(path.name for path in output.iterdir()) == ['a', 'c']
    assert {name: contents(output / name) for name in 'ac'} == expected


@pytest.mark.slow
def test_two_local_workers_give_two_outputs_and_one_named_failure_and_the_next_run_skips_them(
        folder, expected, tmp_path):
    output = tmp_path / 'out'
    run = process(f'{folder}/[abc]', output, '--jobs', '2')
    check(run, folder, output, expected)
    assert f'{output / "c"}: 6 disparities of 6 pairs' in run.stdout
    times = {path: path.stat().st_mtime_ns for path in output.rglob('*')}
    again = process(folder / 'a', folder / 'c', output)
    assert again.returncode == 0
    assert again.stdout.splitlines() == [f'{output / name}: is there already, skipped' for name in 'ac']
    assert {path: path.stat().st_mtime_ns for path in output.rglob('*')} == times


@contextlib.contextmanager
def dask(command, *arguments):
    """A scheduler or a worker in a process of its own; yields the lines of its log."""
    process = subprocess.Popen([sys.executable, '-m', 'dask', command, *map(str, arguments), '--no-dashboard'],
                               stderr=subprocess.PIPE, text=True)
    try:
        yield process.stderr
    finally:
        process.terminate()
        process.communicate(timeout=30)


@pytest.mark.slow
def test_a_cluster_that_is_there_already_is_used(folder, expected, tmp_path):
    with dask('scheduler', '--host', '127.0.0.1', '--port', '0') as log:
        address = next(line.split()[-1] for line in log if 'Scheduler at:' in line)
        with dask('worker', address, '--nthreads', '1', '--host', '127.0.0.1', '--no-nanny') as log:
            next(line for line in log if 'Registered to' in line)
            run = process(folder / 'a', folder / 'b', folder / 'c', tmp_path / 'out', '--scheduler', address)
    check(run, folder, tmp_path / 'out', expected)


def certificates(folder):
    """A certificate of its own authority and its key, by openssl; the files."""
    certificate, key = folder / 'certificate.pem', folder / 'key.pem'
    subprocess.run(['openssl', 'req', '-x509', '-newkey', 'rsa:2048', '-nodes', '-subj', '/CN=svdm-test', '-days', '2',
                    '-keyout', key, '-out', certificate], check=True, capture_output=True)
    return certificate, key


@pytest.mark.slow
@pytest.mark.skipif(shutil.which('openssl') is None, reason='there is no openssl to make certificates with')
def test_a_cluster_with_tls_takes_only_who_has_a_certificate(folder, expected, tmp_path, monkeypatch):
    certificate, key = certificates(tmp_path)
    tls = ('--tls-ca-file', certificate, '--tls-cert', certificate, '--tls-key', key)
    inputs = folder / 'a', folder / 'c'
    with dask('scheduler', '--protocol', 'tls', '--host', '127.0.0.1', '--port', '0', *tls) as log:
        address = next(line.split()[-1] for line in log if 'Scheduler at:' in line)
        assert address.startswith('tls://')
        with dask('worker', address, '--nthreads', '1', '--host', '127.0.0.1', '--no-nanny', *tls) as log:
            next(line for line in log if 'Registered to' in line)
            refused = process(*inputs, tmp_path / 'out', '--scheduler', address)
            assert refused.returncode == 2
            [line] = refused.stderr.splitlines()
            assert 'tls needs certificates: set DASK_DISTRIBUTED__COMM__TLS__CA_FILE' in line
            for name, file in (('CA_FILE', certificate), ('CLIENT__CERT', certificate), ('CLIENT__KEY', key)):
                monkeypatch.setenv(f'DASK_DISTRIBUTED__COMM__TLS__{name}', str(file))
            run = process(*inputs, tmp_path / 'out', '--scheduler', address)
    assert run.returncode == 0, run.stderr
    assert {name: contents(tmp_path / 'out' / name) for name in 'ac'} == expected


@pytest.mark.parametrize(('arguments', 'told'), [
    (('{folder}/a', '{folder}/none', '{out}'), 'none: there is no such file or folder'),
    (('{folder}/a', '{folder}/a/a.mcap', '{out}'), 'would both become'),
    (('{folder}/a', '{folder}/c', '{folder}/a'), 'is no folder for several bags'),
    (('{folder}/a', '{folder}/c', '{out}', '--scheduler', 'tcp://127.0.0.1:9'), 'no Dask scheduler answers there'),
])
def test_what_cannot_begin_is_refused_with_one_line(folder, tmp_path, capsys, monkeypatch, arguments, told):
    from svdm_ros.bags.process import cluster_workers

    monkeypatch.setattr(cluster_workers, '_CONNECT_S', 2)
    given = [text.format(folder=folder, out=tmp_path / 'out') for text in arguments]
    begun = time.monotonic()
    assert main(given) == 2
    assert told in capsys.readouterr().err
    assert time.monotonic() - begun < 20
