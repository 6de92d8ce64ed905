"""Ctrl-C of `svdm`: a quiet end with 130, at whatever moment it comes."""
import pytest
from interruption import interrupted

BENCHMARK = ('-m', 'svdm_core', 'benchmark', '--size', '160x120', '--disparities', '16', '--rounds', '100000')


@pytest.mark.parametrize(('seconds', 'as_terminal'), [(0.3, True), (0.5, True), (4, True), (4, False)])
def test_it_ends_quietly_with_130_and_leaves_no_process(seconds, as_terminal):
    code, _, error = interrupted(BENCHMARK, seconds, as_terminal=as_terminal)
    assert code == 130 and 'Traceback' not in error, error
