"""Sensible values of each parameter, in steps: what a search without ranges tries, what importance is swept over."""
from __future__ import annotations

from ..parameters import MatcherParameters, parameter_info
from .ranges import ParameterRange, Value

_LADDERS: dict[str, tuple[Value, ...]] = {
    'census_weight': (0.0, 0.15, 0.3, 0.5, 0.8),
    'sigma_tree': (0.008, 0.015, 0.03, 0.06, 0.1),
    'p2': (0.0, 0.3, 0.6, 0.9, 1.2),
    'guide_blur': (1, 3, 5),
    'w_p': (1, 11, 17, 23, 31, 41),
    'p2_edge': (0.0, 8.0, 20.0, 50.0),
    'subpixel': (True, False),
    'final_median': (1, 3, 5),
    'sigma_s': (5.0, 8.0, 14.0, 24.0),
    'tau_ad': (0.0, 0.02, 0.04, 0.08),
    'tau_gm': (0.004, 2 / 255, 0.016),
    'alpha': (0.0, 3.0, 6.0, 10.7, 16.0),
    'p1': (0.0, 0.03, 0.07, 0.1, 0.15),
    'uniqueness': (0.0, 0.05, 0.09, 0.15),
    'filling': ('scanline', 'far'),
    'sigma_c': (0.03, 0.06, 0.1, 0.175),
    'median_scope': ('filled', 'all'),
    'gradient': ('horizontal', 'magnitude'),
    'intensity_range': ('pair', 'full'),
}
"""In the order of their importance: how far avgerr nonocc moves over the steps, from `default` on the 15 training pairs
of Middlebury v3 (`svdm tune trainingQ --importance`). What changes the time by much is not among them: choose a preset
first. Nor is what the valid share follows from alone (tau_lr), as it moves no map that is worth having."""


def ladder(name: str) -> ParameterRange:
    """The steps of one parameter; ValueError where it has none."""
    parameter_info(name)
    if name not in _LADDERS:
        raise ValueError(f'{name} has no steps of its own: give its values, as --vary {name}=a,b,c')
    return ParameterRange(name, _LADDERS[name])


def ladders() -> list[ParameterRange]:
    """Those of all parameters that have one, the most important first."""
    return [ladder(name) for name in _LADDERS]


def at_their_defaults(parameters: MatcherParameters) -> MatcherParameters:
    """All that has steps at its default; the rest, which the time follows from, as it is."""
    default = MatcherParameters().as_dict()
    return parameters.replace(**{name: default[name] for name in _LADDERS})


def near(steps: ParameterRange, value: Value) -> list[Value]:
    """The steps next to a value, and the default where that is another one; what is no number has no next step."""
    default = getattr(MatcherParameters(), steps.name)
    others = [step for step in steps.values if step != value]
    if steps.numeric:
        below = [step for step in others if float(step) < float(value)][-1:]
        above = [step for step in others if float(step) > float(value)][:1]
        others = [*below, *above, *([default] if default != value and default not in below + above else [])]
    return others


def by_importance() -> list[str]:
    """The names of the parameters that have steps, the most important first."""
    return list(_LADDERS)
