"""How the node's benchmark counts, what it refuses, and a run of it over DDS."""
import json
import statistics
import subprocess
import sys

import pytest
from checkout import CHECKOUT

from svdm_ros.benchmark import node_benchmark as benchmark
from svdm_ros.benchmark.measurement import MatcherReport, figures, matcher_mean
from svdm_ros.processes.children import RunError

SECOND = 10**9


def test_figures_are_of_the_seconds_that_count():
    first = 100 * SECOND
    sent = [first + index * SECOND // 10 for index in range(100)]  # 10 Hz
    times = [(stamp, stamp + 50_000_000) for stamp in sent[::2]]
    times[0] = (first - 1, first)
    result = figures(sent, times, [], 2.0, {'latency p50 (ms)': '12.5'})
    assert result['in_hz'] == 10 and result['out_hz'] == 5
    assert result['latency_ms'] == pytest.approx({'mean': 50, 'p50': 50, 'p90': 50, 'p99': 50})
    assert result['node_latency_ms'] == 12.5 and result['matcher_ms'] is None


def test_nothing_in_the_seconds_that_count_is_an_error():
    with pytest.raises(RunError, match=r'no disparity image arrived in the 2 s'):
        figures([], [(0, SECOND)], [], 2.0, {})


def test_the_matchers_mean_is_weighted_by_frames_and_leaves_out_what_reaches_beyond():
    reports = [MatcherReport(0, 0, 99.0), MatcherReport(1, 10, 99.0), MatcherReport(2, 40, 20.0),
               MatcherReport(3, 50, 40.0), MatcherReport(4, 90, 99.0)]
    assert matcher_mean(reports, 1, 3) == pytest.approx((30 * 20 + 10 * 40) / 40)
    assert matcher_mean(reports, 2, 2) is None
    assert matcher_mean([], 0, 9) is None


@pytest.mark.parametrize(('arguments', 'words'), [
    (['--rate', '0'], "'0' is not allowed: it must be a number above 0"),
    (['--seconds', 'nan'], "'nan' is not allowed"),
    (['--size', '640'], "'640' is not a size"),
    (['--preset', 'none'], "invalid choice: 'none'"),
])
def test_a_wrong_argument_is_named(arguments, words, capsys):
    with pytest.raises(SystemExit) as end:
        benchmark._parse(arguments)
    assert end.value.code == 2 and words in capsys.readouterr().err


def run_module(name, *arguments):
    return subprocess.run([sys.executable, '-m', name, *arguments], cwd=CHECKOUT, capture_output=True, text=True,
                          timeout=100)


def test_it_measures_and_overwrites_nothing(tmp_path):
    file = tmp_path / 'node.json'
    arguments = ('--size', '160x120', '--rate', '10', '--seconds', '1', '--json', str(file))
    run = run_module('svdm_ros.benchmark', *arguments)
    assert run.returncode == 0, run.stderr
    measured = json.loads(file.read_text())
    assert 4 < measured['out_hz'] < 12 and measured['latency_ms']['p50'] > 0
    assert len(measured['first_output_s']) == 3 and statistics.median(measured['first_output_s']) < 1
    assert run.stdout.startswith('160x120 grey, preset fast: ')
    before = file.read_bytes()
    again = run_module('svdm_ros.benchmark', *arguments)
    assert again.returncode == 2 and 'node.json exists already' in again.stderr and file.read_bytes() == before


def test_a_size_beyond_the_memory_is_refused():
    run = run_module('svdm_ros.benchmark', '--size', '200000x200000')
    assert run.returncode == 2 and 'GB are free: take smaller images' in run.stderr


def test_the_node_tells_how_it_is_used():
    run = run_module('svdm_ros', '--help')
    assert run.returncode == 0 and run.stdout.startswith('usage: disparity_node')


def test_the_node_refuses_what_it_does_not_know():
    run = run_module('svdm_ros', 'num_disparities:=96')
    assert run.returncode == 2 and run.stdout == ''
    assert run.stderr.startswith("disparity_node: unknown argument 'num_disparities:=96': ")
