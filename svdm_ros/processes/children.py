"""Child processes of demo and benchmark: where they run, what they said, and that none of them is left behind."""
from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

LAST_LINES = 8


class RunError(Exception):
    """What went wrong with a run of them, in one line; what a log says about it may follow on further lines."""


def isolated_environment(log_folder: Path, profile: Path) -> dict[str, str]:
    """Environment variables that keep these processes to themselves, with image-sized shared memory."""
    return {
        'ROS_DOMAIN_ID': str(60 + os.getpid() % 42),  # people take low ones; ports of those above 101 may be taken
        'ROS_AUTOMATIC_DISCOVERY_RANGE': 'LOCALHOST',
        'ROS_LOG_DIR': str(log_folder),
        'RMW_IMPLEMENTATION': 'rmw_fastrtps_cpp',
        'FASTRTPS_DEFAULT_PROFILES_FILE': str(profile),
        'RCUTILS_COLORIZED_OUTPUT': '0',
        'PYTHONUNBUFFERED': '1',
        # The package that runs now, and no other that may be installed.
        'PYTHONPATH': os.pathsep.join(filter(None, [str(_package_root()), os.environ.get('PYTHONPATH')])),
    }


class Child:
    """A Python module that runs as a process of its own, its output in a file, which need not stay."""

    def __init__(self, name: str, log: Path, module: str, *arguments: str, log_stays: bool = True) -> None:
        self.name = name
        self.log = log
        self._log_stays = log_stays
        with log.open('w') as output:
            self._process = subprocess.Popen(
                [sys.executable, '-m', module, *arguments],
                stdin=subprocess.DEVNULL, stdout=output, stderr=subprocess.STDOUT,
                start_new_session=True,  # Ctrl-C reaches this process only, which ends the children in order
            )

    def check(self) -> None:
        """Raise RunError where the process has ended."""
        code = self._process.poll()
        if code is not None:
            end = f'ended with exit code {code}' if code >= 0 else f'was killed by {signal.Signals(-code).name}'
            raise RunError(f'the {self.name} {end}{self.last_words()}')

    @property
    def pid(self) -> int:
        return self._process.pid

    def send(self, number: signal.Signals) -> None:
        """Send a signal."""
        self._process.send_signal(number)

    def is_done(self) -> bool:
        """Whether it has ended as it should. RunError where it has ended otherwise."""
        if self._process.poll() != 0:
            self.check()
            return False
        return True

    def output(self) -> str:
        """All it has said so far."""
        return self.log.read_text(errors='replace')

    def last_words(self) -> str:
        """The last lines of the log, as an appendix to a message."""
        lines = self.output().splitlines()[-LAST_LINES:]
        if not lines:
            return ' without a word'
        log = f'its log {self.log}' if self._log_stays else 'its log'
        return '\n'.join([f'; {log} ends with', *(f'    {line}' for line in lines)])

    def stop(self) -> int:
        """Ask the process to end, insist where it does not; returns its exit code."""
        for request, patience in ((signal.SIGINT, 5.0), (signal.SIGTERM, 2.0), (signal.SIGKILL, None)):
            if self._process.poll() is None:
                self._process.send_signal(request)
            try:
                return self._process.wait(patience)
            except subprocess.TimeoutExpired:
                continue
        return self._process.wait()


def _package_root() -> Path:
    return Path(__file__).resolve().parents[2]
