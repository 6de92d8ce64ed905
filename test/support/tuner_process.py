"""The tuner as a process of its own, and a real browser that looks at its page."""
import contextlib
import os
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest
from checkout import CHECKOUT

LIMIT = 30.0
_FLAGS = ['--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run', '--disable-background-networking',
          '--disable-component-update', '--disable-sync']


def free_port():
    with socket.socket() as taken:
        taken.bind(('127.0.0.1', 0))
        return taken.getsockname()[1]


def wait_until(condition, what, limit=LIMIT):
    """Its value once that is true."""
    end = time.monotonic() + limit
    while not (value := condition()):
        assert time.monotonic() < end, f'not within {limit} s: {what}'
        time.sleep(0.02)
    return value


class Tuner:
    """`python -m svdm_ros.tuner` with arguments; its output in a file."""

    def __init__(self, folder, *arguments, **environment):
        self.port = free_port()
        self._log = folder / f'tuner{self.port}.log'
        at = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
        given = map(str, ['--port', self.port, '--folder', folder, *arguments[:at]])
        variables = {**os.environ, **environment,
                     'PYTHONPATH': os.pathsep.join([str(CHECKOUT), os.environ.get('PYTHONPATH', '')])}
        variables.pop('PYTEST_CURRENT_TEST', None)  # with it NiceGUI takes itself for a part of the test
        with self._log.open('w') as output:
            self._process = subprocess.Popen(
                [sys.executable, '-m', 'svdm_ros.tuner', *given, *map(str, arguments[at:])], cwd=folder, stdout=output,
                stderr=subprocess.STDOUT, env=variables)

    @property
    def address(self):
        return f'http://127.0.0.1:{self.port}'

    @property
    def log(self):
        return self._log.read_text()

    @property
    def pid(self):
        return self._process.pid

    def wait_until_served(self):
        def is_there():
            assert self._process.poll() is None, self.log
            return f'tuner: {self.address}' in self.log

        wait_until(is_there, 'the page is served')

    def send(self, number):
        self._process.send_signal(number)

    def exit_code(self):
        return self._process.wait(LIMIT)

    def kill(self):
        if self._process.poll() is None:
            self._process.kill()
            self._process.wait()

    def status(self, **headers):
        """Of a request for the page."""
        request = urllib.request.Request(self.address, headers=headers)
        try:
            with urllib.request.urlopen(request, timeout=LIMIT) as answer:
                return answer.status
        except urllib.error.HTTPError as error:
            with error:
                return error.code


@contextlib.contextmanager
def running_tuner(folder, *arguments, **environment):
    tuner = Tuner(folder, *arguments, **environment)
    try:
        tuner.wait_until_served()
        yield tuner
    finally:
        tuner.kill()


@contextlib.contextmanager
def browser():
    """Chromium, headless, driven by Playwright; the test is skipped where one of them is not installed."""
    playwright = pytest.importorskip('playwright.sync_api', reason='playwright is not installed')
    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    if chromium is None:
        pytest.skip('no chromium on PATH')
    with playwright.sync_playwright() as driver:
        started = driver.chromium.launch(executable_path=chromium, args=_FLAGS)
        try:
            yield started
        finally:
            started.close()
