"""Stereo matching by the four stages of the horizontal-streak paper (Gan et al. 2024); no ROS in here."""
# ruff: noqa: E402 - the order counts: what follows takes a second
from .runtime.interrupts import end_quietly_if_command

end_quietly_if_command()

from .parameters import MatcherParameters, ParameterInfo, parameter_info, parameter_table
from .presets import load_preset, preset_names
from .runtime.memory_reuse import keep_freed_memory
from .runtime.thread_waiting import wait_briefly

wait_briefly()
keep_freed_memory()
from .matcher import DisparityResult, StereoMatcher

__all__ = [
    'DisparityResult',
    'MatcherParameters',
    'ParameterInfo',
    'StereoMatcher',
    'load_preset',
    'parameter_info',
    'parameter_table',
    'preset_names',
]
