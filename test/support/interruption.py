"""A command that gets SIGINT."""
import os
import signal
import subprocess
import sys
import time

import pytest
from checkout import CHECKOUT


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
