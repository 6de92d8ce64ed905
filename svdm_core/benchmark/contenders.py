"""Who takes part in a benchmark: presets, parameter files, OpenCV's methods; and how much each of them does."""
from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from ..disparity_refinement.refinement import in_bytes
from ..evaluation.opencv_matchers import OPENCV_METHODS
from ..exact_route import is_exact
from ..parameters import MatcherParameters
from ..presets import PresetNotFoundError, load_preset, preset_names

_OWN = 'svdm-'
_OPENCV_WORK = {
    'bm': 'blocks of 15x15, 1 view',
    'sgbm-3way': '3 paths, 1 view',
    'sgbm-hh4': '4 paths, 1 view',
    'sgbm-hh': '8 paths, 1 view',
}
_OPENCV_THREADS = {'sgbm-3way': 4, 'sgbm-hh': 1}
"""The most threads that OpenCV's methods use, where there is a limit: HH has no parallel part, 3WAY four stripes."""


def contender_names(methods: Sequence[str]) -> list[str]:
    """'svdm-fast' for a preset, a file as it was given, OpenCV's methods as they are; each once.

    Raises ValueError naming what is none of these, or a file with wrong content.
    """
    names = list(dict.fromkeys(_name(method.strip()) for method in methods))
    for name in filter(is_own, names):
        parameters_of(name)
    return names


def all_methods() -> list[str]:
    """All presets that come with the package, then OpenCV's methods."""
    return [*preset_names(), *OPENCV_METHODS]


def is_own(name: str) -> bool:
    """Whether a contender is this package's matcher."""
    return name not in OPENCV_METHODS


def parameters_of(name: str) -> MatcherParameters:
    """The parameters of an own contender."""
    try:
        return load_preset(name.removeprefix(_OWN))
    except PresetNotFoundError:
        known = ', '.join(all_methods())
        raise ValueError(f'method {name.removeprefix(_OWN)!r} is not allowed: it must be one of {known}, '
                         'or a .yaml file that is there') from None


def work_of(name: str) -> str:
    """The paths and the matched views, which one evaluated disparity of a contender stands for."""
    if not is_own(name):
        return _OPENCV_WORK[name]
    parameters = parameters_of(name)
    if is_exact(parameters):
        return 'no paths, 2 views'
    views = round(1 + 1 / parameters.right_rows, 2)
    return f'{parameters.paths} paths, {views:g} views'


def threads_used(name: str, threads: int) -> int:
    """How many of `threads` a contender makes use of at all."""
    return min(threads, _OPENCV_THREADS.get(name, threads))


def why_not_modelled(parameters: MatcherParameters) -> str:
    """Why the work-span model says nothing of these parameters; empty where it does."""
    if is_exact(parameters):
        return 'its trees over the whole image are two tasks, one for each view'
    if not in_bytes(parameters):
        return 'its literal weighted median is no phase of tasks'
    return ''


def _name(method: str) -> str:
    if not is_own(method) or method.startswith(_OWN) or Path(method).suffix in ('.yaml', '.yml'):
        return method
    return f'{_OWN}{method}'
