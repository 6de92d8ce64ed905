"""Kernels come from the cache as long as no source has changed, and are compiled where there is no cache."""
import importlib
import os
import pkgutil
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest
from numba.core.dispatcher import Dispatcher

import svdm_core
from svdm_core.kernels import cache

CORE = Path(svdm_core.__file__).resolve().parent
KERNEL_FOLDER = 'svdm_kernels_'
SMALL_PACKAGE = {
    '__init__.py': '',
    'kernels/__init__.py': '',
    'kernels/deeper/constants.py': 'FACTOR = 3\n',
    'commands/texts.py': 'TITLE = "small"\n',
    'matching_cost/__init__.py': '',
    'matching_cost/scaling.py': '''from ..kernels.compilation import kernel
from ..kernels.deeper.constants import FACTOR


@kernel
def scaled(x):
    return x * FACTOR
''',
}


class Installation:
    """A folder with a package that uses `kernels/compilation.py`, and the environment it is imported in."""

    def __init__(self, folder):
        self.folder, self.package = folder, folder / 'small'
        self.package.mkdir()
        for name, text in SMALL_PACKAGE.items():
            (self.package / name).parent.mkdir(parents=True, exist_ok=True)
            (self.package / name).write_text(text)
        for name in ('cache.py', 'cache_files.py', 'compilation.py'):
            shutil.copy2(CORE / 'kernels' / name, self.package / 'kernels')
        self.home, self.temporary = folder / 'home', folder / 'tmp'
        self.home.mkdir()
        self.temporary.mkdir()

    def run(self, code='from small.matching_cost.scaling import scaled; print(scaled(2))', **environment):
        """What a process of its own prints to stdout and stderr."""
        own = ('NUMBA_CACHE_DIR', 'XDG_CACHE_HOME')
        run = subprocess.run(
            [sys.executable, '-c', code], cwd=self.folder, capture_output=True, text=True, timeout=60, check=False,
            env={key: value for key, value in os.environ.items() if key not in own}
            | {'HOME': str(self.home), 'TMPDIR': str(self.temporary)} | environment)
        assert run.returncode == 0, run.stderr
        return run.stdout.strip(), run.stderr.strip()

    def make_unwritable(self):
        """Neither package nor home can hold a cache, not even for root, whom no file mode stops."""
        for folder in (self.package / '__pycache__', self.home):
            shutil.rmtree(folder, ignore_errors=True)
            folder.write_text('a file where a folder is looked for')

    def compiled(self, place=None):
        """Time of writing of each compiled kernel; by default of those beside the package."""
        place = self.package / '__pycache__' if place is None else place
        return {path: path.stat().st_mtime_ns for path in place.glob(f'{KERNEL_FOLDER}*/**/*.nbc')}


@pytest.fixture
def installation(tmp_path):
    return Installation(tmp_path)


def test_kernels_are_compiled_anew_when_another_module_of_theirs_changes_and_only_then(installation):
    assert installation.run() == ('6', '')
    first = installation.compiled()
    assert len(first) == 1
    assert installation.run() == ('6', '')
    assert installation.compiled() == first
    (installation.package / 'commands' / 'texts.py').write_text('TITLE = "other"\n')
    assert installation.run() == ('6', '')
    assert installation.compiled() == first
    (installation.package / 'kernels' / 'deeper' / 'constants.py').write_text('FACTOR = 50\n')
    assert installation.run() == ('100', '')
    assert installation.compiled().items() > first.items()


def test_where_nothing_can_be_written_kernels_are_compiled_and_one_line_says_so(installation):
    installation.make_unwritable()
    result, told = installation.run()
    assert result == '6'
    assert len(told.splitlines()) == 1
    assert 'compiled at each start' in told
    assert 'set NUMBA_CACHE_DIR' in told
    assert list(installation.temporary.iterdir()) == []


def test_svdm_core_itself_is_imported_where_nothing_can_be_written(installation):
    shutil.copytree(CORE, installation.folder / 'svdm_core', ignore=shutil.ignore_patterns('__pycache__'))
    installation.package = installation.folder / 'svdm_core'
    installation.make_unwritable()
    code = 'import svdm_core.matching_cost.planes as module; print(module.__file__)'
    place, told = installation.run(code)
    assert Path(place).is_relative_to(installation.folder)
    assert len(told.splitlines()) == 1
    assert 'set NUMBA_CACHE_DIR' in told


def test_the_folder_that_numba_is_told_comes_first(installation):
    asked = installation.folder / 'asked'
    installation.run(NUMBA_CACHE_DIR=str(asked))
    assert len(installation.compiled(asked)) == 1
    assert installation.compiled() == {}


@pytest.mark.parametrize('asked', [True, False])
def test_the_users_cache_serves_a_package_that_cannot_be_written(installation, asked):
    (installation.package / '__pycache__').write_text('')
    place = installation.folder / 'xdg' if asked else installation.home / '.cache'
    environment = {'XDG_CACHE_HOME': str(place)} if asked else {}
    assert installation.run(**environment) == ('6', '')
    assert len(installation.compiled(place / 'svdm_core')) == 1


def test_folders_that_were_not_used_for_a_month_are_removed_and_nothing_else(installation):
    place = installation.package / '__pycache__'
    month_ago, week_ago = time.time() - 31 * 24 * 3600, time.time() - 7 * 24 * 3600
    for name, used in ((f'{KERNEL_FOLDER}old', month_ago), (f'{KERNEL_FOLDER}other', week_ago), ('mine', month_ago)):
        (place / name / 'inside').mkdir(parents=True)
        os.utime(place / name, (used, used))
    installation.run()
    [own] = {path.parents[1] for path in installation.compiled()}
    os.utime(own, (month_ago, month_ago))
    installation.run()
    assert time.time() - own.stat().st_mtime < 60
    assert {path.name for path in place.iterdir() if path.is_dir()} == {own.name, f'{KERNEL_FOLDER}other', 'mine'}


def test_every_kernel_is_in_a_folder_of_the_sources():
    modules = [importlib.import_module(module.name) for module in pkgutil.walk_packages([CORE], 'svdm_core.')
               if not module.name.endswith('__main__')]
    kernels = [kernel for module in modules for kernel in vars(module).values() if isinstance(kernel, Dispatcher)]
    assert len(kernels) > 10
    outside = {kernel.__name__ for kernel in kernels if KERNEL_FOLDER not in kernel.stats.cache_path}
    assert outside == set()
    places = {Path(kernel.py_func.__code__.co_filename).relative_to(CORE).parts[0] for kernel in kernels}
    assert places <= set(cache._KERNEL_FOLDERS)


def test_a_copy_of_the_package_elsewhere_needs_no_compilation(installation, tmp_path):
    shared = tmp_path / 'shared'
    assert installation.run(NUMBA_CACHE_DIR=str(shared)) == ('6', '')
    first = installation.compiled(shared)
    copy = tmp_path / 'elsewhere'
    copy.mkdir()
    shutil.copytree(installation.package, copy / 'small')
    installation.folder = copy
    assert installation.run(NUMBA_CACHE_DIR=str(shared)) == ('6', '')
    assert installation.compiled(shared) == first and len(first) == 1
