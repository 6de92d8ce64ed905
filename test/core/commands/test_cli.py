"""The command line as a whole; each command has tests of its own."""
import subprocess
import sys

import pytest

from svdm_core.commands import cli

# An import of these fails, as where the extra `cli` is not installed.
WITHOUT_EXTRAS = '''
import sys
for name in ("rich", "matplotlib", "jinja2", "skimage"):
    sys.modules[name] = None
from svdm_core.commands import cli
'''


def _without_extras(arguments):
    return subprocess.run([sys.executable, '-c', f'{WITHOUT_EXTRAS}sys.exit(cli.main({arguments!r}))'],
                          capture_output=True, text=True, timeout=100)


@pytest.mark.parametrize('arguments', [['--help'], *([name, '--help'] for name in cli.COMMANDS)])
def test_help_needs_no_extras(arguments):
    run = _without_extras(arguments)
    assert run.returncode == 0 and run.stdout.startswith('usage: svdm') and run.stderr == ''


def test_warmup_needs_no_extras():
    run = _without_extras(['warmup'])
    assert run.returncode == 0 and run.stdout.splitlines()[-1].startswith('ready after '), run.stderr


def test_what_is_missing_is_said_in_one_line():
    run = _without_extras(['benchmark', '--rounds', '1'])
    assert run.returncode == 2 and 'rich' in run.stderr and len(run.stderr.splitlines()) == 1


@pytest.mark.parametrize('arguments', [[], ['matsch']])
def test_an_unknown_command_is_told_what_there_is(arguments, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(arguments)
    assert end.value.code == 2 and 'usage: svdm' in capsys.readouterr().err
