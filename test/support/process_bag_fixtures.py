"""A small recording, and the command run on it."""
import pytest
from recordings import SMALL, stereo, write

from svdm_ros.bags.process_bag import main


@pytest.fixture(scope='module')
def bag(tmp_path_factory):
    return write(tmp_path_factory.mktemp('input') / 'bag', stereo(5))


@pytest.fixture
def run(tmp_path, capsys):
    """Runs the command on an input; the exit code, what it printed and its error line."""
    def call(source, *options, output='out', code=0):
        got = main([str(source), str(tmp_path / output), *SMALL, *options])
        printed = capsys.readouterr()
        assert got == code, printed
        assert printed.err.count('\n') <= 1
        return printed.out + printed.err
    return call
