"""Ctrl-C of the node's benchmark: a quiet end with 130, at whatever moment it comes."""
import pytest
from interruption import interrupted

COMMAND = ('-m', 'svdm_ros.benchmark', '--seconds', '1000')


@pytest.mark.parametrize(('seconds', 'as_terminal'), [(0.3, False), (1.5, True), (6, True)])
def test_it_ends_quietly_with_130_and_leaves_no_process(seconds, as_terminal):
    code, _, error = interrupted(COMMAND, seconds, as_terminal=as_terminal)
    assert code == 130 and 'Traceback' not in error, error
