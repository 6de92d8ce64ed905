"""Stereo matching by the four stages of the horizontal-streak paper (Gan et al. 2024); no ROS in here.

Importing it takes no time and changes nothing in the process: the names below are imported when they are first used.
A program that is to run the matcher for long may call `svdm_core.runtime.configure()` first.
"""
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from .confidence_meaning import chance_wrong
    from .matcher import DisparityResult, StereoMatcher
    from .memory import NotEnoughMemoryError
    from .parameters import MatcherParameters, ParameterInfo, parameter_info, parameter_table
    from .presets import load_preset, preset_names
    from .row_alignment.alignment import RowAlignment
    from .row_alignment.estimation import estimate_row_alignment
    from .row_alignment.tracking import RowTracker

__all__ = [
    'DisparityResult',
    'MatcherParameters',
    'NotEnoughMemoryError',
    'ParameterInfo',
    'RowAlignment',
    'RowTracker',
    'StereoMatcher',
    'chance_wrong',
    'estimate_row_alignment',
    'load_preset',
    'parameter_info',
    'parameter_table',
    'preset_names',
]

_MODULES = {
    'confidence_meaning': ('chance_wrong',),
    'matcher': ('DisparityResult', 'StereoMatcher'),
    'memory': ('NotEnoughMemoryError',),
    'parameters': ('MatcherParameters', 'ParameterInfo', 'parameter_info', 'parameter_table'),
    'presets': ('load_preset', 'preset_names'),
    'row_alignment.alignment': ('RowAlignment',),
    'row_alignment.estimation': ('estimate_row_alignment',),
    'row_alignment.tracking': ('RowTracker',),
}


def __getattr__(name: str) -> Any:
    for module, names in _MODULES.items():
        if name in names:
            value = globals()[name] = getattr(import_module(f'.{module}', __name__), name)
            return value
    raise AttributeError(f'module {__name__!r} has no attribute {name!r}')


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
