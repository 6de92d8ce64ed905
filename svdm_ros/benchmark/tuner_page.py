"""How long the tuner's page takes from a slider to the new picture, and what it keeps in memory while it is open.

python -m svdm_ros.benchmark.tuner_page [--moves 40] [--minutes 0]

The page of the demo pair at 640x480, in a real browser (Chromium, headless, driven by Playwright), on this machine.
"""
from __future__ import annotations

import argparse
import contextlib
import random
import shutil
import statistics
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2

from svdm_core.commands.argument_types import count, not_negative
from svdm_core.missing_modules import missing_line

from ..processes.children import Child, RunError
from ..processes.scene import load_scene

_PORT = 8099
_SIZE = (640, 480)
_PATIENCE = 60.0  # s
_FLAGS = ['--no-sandbox', '--disable-gpu', '--no-first-run', '--disable-background-networking',
          '--disable-component-update', '--disable-sync']
_MOVED = 'census_weight'
_CLOCK = """([name, key]) => new Promise(resolve => {
  const image = document.querySelector('img[alt="disparity"]');
  const slider = document.querySelector(`.control[data-name="${name}"] .q-slider__track-container`);
  const before = image.src, begun = performance.now();
  const shown = () => {
    if (image.src === before) return;
    image.removeEventListener('load', shown);
    resolve(performance.now() - begun);
  };
  image.addEventListener('load', shown);
  for (const kind of ['keydown', 'keyup'])
    slider.dispatchEvent(new KeyboardEvent(kind, {keyCode: key, which: key, bubbles: true}));
})"""
"""Moves a slider by a step; gives the milliseconds until the browser has loaded another picture."""
_RIGHT, _LEFT = 39, 37


def main() -> int:
    """Entry of the command: 0, or 1 or 2 with one line that says what went wrong."""
    options = _parse()
    try:
        with tempfile.TemporaryDirectory() as folder, _page(Path(folder)) as (page, tuner):
            _measure(page, options.moves)
            if options.minutes:
                _watch(page, tuner, 60 * options.minutes)
    except ImportError as error:
        print(f'tuner_page: {missing_line(error)}', file=sys.stderr)
        return 2
    except RunError as error:
        print(f'tuner_page: {error}', file=sys.stderr)
        return 1
    return 0


def _parse() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog='tuner_page', description=__doc__,
                                     formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument('--moves', type=count, default=40, metavar='N', help='of the slider (40)')
    parser.add_argument('--minutes', type=not_negative, default=0.0, metavar='M',
                        help='keep the page open for so long, move a slider each second, and tell the memory (0)')
    return parser.parse_args()


@contextlib.contextmanager
def _page(folder: Path) -> Iterator[tuple[Any, Child]]:
    from playwright.sync_api import sync_playwright

    chromium = shutil.which('chromium') or shutil.which('google-chrome')
    if chromium is None:
        raise RunError('chromium is not on PATH: install it (apt: chromium)')
    scene = load_scene()
    for name, image in (('left', scene.left), ('right', scene.right)):
        cv2.imwrite(str(folder / f'{name}.png'), cv2.resize(image, _SIZE, interpolation=cv2.INTER_AREA))
    tuner = Child('tuner', folder / 'log', 'svdm_ros.tuner', str(folder / 'left.png'), str(folder / 'right.png'),
                  '--port', str(_PORT), '--folder', str(folder), log_stays=False)
    try:
        end = time.monotonic() + _PATIENCE
        while 'http://' not in tuner.output():
            tuner.check()
            if time.monotonic() > end:
                raise RunError(f'no page within {_PATIENCE:.0f} s')
            time.sleep(0.05)
        with sync_playwright() as driver:
            browser = driver.chromium.launch(executable_path=chromium, args=_FLAGS)
            page = browser.new_page()
            page.goto(f'http://127.0.0.1:{_PORT}')
            page.wait_for_function('document.querySelector(\'img[alt="disparity"]\')?.src', timeout=1000 * _PATIENCE)
            yield page, tuner
            browser.close()
    finally:
        tuner.stop()


def _moved(page: Any, number: int) -> float:
    """ms until the picture of another value is there: one step to the right, then back."""
    return float(page.evaluate(_CLOCK, [_MOVED, _LEFT if number % 2 else _RIGHT]))


def _frame(page: Any) -> float:
    """ms that the page tells of a frame."""
    text = page.get_by_text('time of a frame', exact=True).locator('xpath=following-sibling::*[1]').inner_text()
    return float(text.split()[0])


def _measure(page: Any, moves: int) -> None:
    chance = random.Random(0)
    _moved(page, 0)
    _moved(page, 1)
    beside, frames = [], []
    for number in range(moves):
        time.sleep(chance.uniform(0.2, 0.4))  # no multiple of the page's own rhythm
        taken = _moved(page, number)
        time.sleep(0.15)
        frames.append(_frame(page))
        beside.append(taken - frames[-1])
    print(f'{moves} moves of {_MOVED}, {_SIZE[0]}x{_SIZE[1]} in colour: from the slider to the picture in the browser '
          f'{statistics.median(beside):.0f} ms in the median and {max(beside):.0f} ms at most beside the matcher, '
          f'whose frames take {statistics.median(frames):.0f} ms')


def _watch(page: Any, tuner: Child, seconds: float) -> None:
    begun = time.monotonic()
    kept: list[tuple[float, float]] = []
    number = 0
    while (now := time.monotonic() - begun) < seconds or len(kept) < 2:
        _moved(page, number)
        number += 1
        if now >= len(kept) * seconds / 10:
            kept.append((_resident(tuner.pid), page.evaluate('performance.memory.usedJSHeapSize') / 1e6))
            print(f'{now / 60:5.1f} min, {number} pictures: tuner {kept[-1][0]:.0f} MB, page {kept[-1][1]:.0f} MB',
                  flush=True)
        time.sleep(1.0)
    print(f'from the second look to the last: tuner {kept[-1][0] - kept[1][0]:+.1f} MB, page '
          f'{kept[-1][1] - kept[1][1]:+.1f} MB')


def _resident(pid: int) -> float:
    """MB."""
    status = Path(f'/proc/{pid}/status').read_text()
    return int(next(line for line in status.splitlines() if line.startswith('VmRSS')).split()[1]) / 1e3


if __name__ == '__main__':
    sys.exit(main())
