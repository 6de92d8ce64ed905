"""Ctrl-C of the commands: a quiet end with 130, at whatever moment it comes."""
import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

CHECKOUT = Path(__file__).resolve().parents[1]
BENCHMARK = ('-m', 'svdm_core', 'benchmark', '--size', '160x120', '--disparities', '16', '--rounds', '100000')
NODE_BENCHMARK = ('-m', 'svdm_ros.node_benchmark', '--seconds', '1000')


def interrupted(arguments, seconds, *, as_terminal):
    """Exit code and what is printed of a command that gets SIGINT; as a terminal sends it, its children get it too."""
    process = subprocess.Popen([sys.executable, *arguments], cwd=CHECKOUT, stdout=subprocess.PIPE,
                               stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        time.sleep(seconds)
        assert process.poll() is None, process.communicate()
        (os.killpg if as_terminal else os.kill)(process.pid, signal.SIGINT)
        output = process.communicate(timeout=30)
    finally:
        process.kill()
    with pytest.raises(ProcessLookupError):  # none of its children is left
        os.killpg(process.pid, 0)
    return process.returncode, *output


@pytest.mark.parametrize(('arguments', 'seconds', 'as_terminal'), [
    (BENCHMARK, 0.5, True), (BENCHMARK, 4, True), (BENCHMARK, 4, False),
    (NODE_BENCHMARK, 0.3, False), (NODE_BENCHMARK, 1.5, True), (NODE_BENCHMARK, 6, True)])
def test_it_ends_quietly_with_130_and_leaves_no_process(arguments, seconds, as_terminal):
    code, _, error = interrupted(arguments, seconds, as_terminal=as_terminal)
    assert code == 130 and 'Traceback' not in error, error
