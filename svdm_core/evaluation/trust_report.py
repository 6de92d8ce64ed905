"""What an evaluation says of confidences: collected scene by scene, as --json has it."""
from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from ..confidence_meaning import chance_wrong
from ..shown import cut
from .confidence_fit import left_out_figures
from .datasets import StereoScene
from .scene_evaluation import REGIONS, Answer, JudgedScene, known_pixels, wrong_pixels
from .trust_curves import (
    COVERAGES,
    Numbers,
    Tally,
    area,
    auc,
    calibration_error,
    kept_and_wrong,
    reliability,
    tally_of,
    wrong_at,
)

THRESHOLDS = (1, 2)
"""px of the images matched; who is off by more is wrong."""

FITTED = 'all', 1
"""Region and threshold of `chance_wrong`."""

type Kind = tuple[str, int]  # of REGIONS and THRESHOLDS


@dataclasses.dataclass(slots=True)
class _Collected:
    """Of a method, by region and threshold: scene -> what is kept by its own check, in %, and wrong of it; scene ->
    pixels by confidence, where it has one."""

    checked: dict[Kind, dict[str, tuple[float, float]]]
    tallies: dict[Kind, dict[str, Tally]]


class TrustReport:
    """Collects what is kept and what is wrong, scene by scene; keeps no maps."""

    def __init__(self) -> None:
        self._methods: dict[str, _Collected] = {}

    def add(self, scene: StereoScene, judged: Mapping[str, JudgedScene]) -> None:
        """Count the pixels of a scene."""
        for method, one in judged.items():
            kinds: list[Kind] = [(region, threshold) for region in REGIONS for threshold in THRESHOLDS]
            collected = self._methods.setdefault(method, _Collected({kind: {} for kind in kinds},
                                                                    {kind: {} for kind in kinds}))
            _count(collected, scene, one.answer)

    def document(self) -> dict[str, dict[str, Any]]:
        """Method -> region -> figures; means in which each scene counts alike."""
        return {method: {region: _region_figures(collected, region) for region in REGIONS}
                for method, collected in self._methods.items()}

    def fit(self, method: str) -> dict[str, Any]:
        """The two constants of `chance_wrong`, as `left_out_figures` gives them. ValueError where it cannot be."""
        return left_out_figures(self._methods[method].tallies[FITTED])


def confidence_lines(methods: Mapping[str, Any]) -> list[str]:
    """A line a method for the terminal. methods: name -> its part of the document."""
    lines = []
    for name, method in methods.items():
        region, threshold = FITTED
        figures = method['confidence'][region][f'wrong_by_{threshold}px']
        check = figures['own_check']
        told = (f'{cut(name)}, all pixels, off by more than {threshold} px of the images: {check["wrong"]:.1f} % of '
                f'the {check["kept"]:.1f} % that its own check keeps')
        if 'wrong' in figures:
            shown = ', '.join(f'{figures["wrong"][coverage - 1]:.1f} % of the surest {coverage} %'
                              for coverage in (100, 80, 50))
            lines += [told, f'  by confidence: {shown}; AUC {written_auc(figures["auc"])}']
        else:
            lines.append(told)
    return lines


def written_auc(value: float | None) -> str:
    """Three digits, '-' where all pixels of each scene are right or all are wrong."""
    return '-' if value is None else f'{value:.3f}'


def _count(collected: _Collected, scene: StereoScene, answer: Answer) -> None:
    for region, known in known_pixels(scene).items():
        for threshold in THRESHOLDS:
            wrong = wrong_pixels(answer, scene, known, threshold)
            collected.checked[region, threshold][scene.name] = kept_and_wrong(answer.valid[known], wrong)
            if answer.confidence is not None:
                collected.tallies[region, threshold][scene.name] = tally_of(answer.confidence[known], wrong)


def _region_figures(collected: _Collected, region: str) -> dict[str, Any]:
    figures: dict[str, Any] = {}
    for threshold in THRESHOLDS:
        kept, wrong = np.mean(list(collected.checked[region, threshold].values()), axis=0).tolist()
        figures[f'wrong_by_{threshold}px'] = {'own_check': {'kept': kept, 'wrong': wrong},
                                              **_curve(collected.tallies[region, threshold])}
    tallies = collected.tallies[region, FITTED[1]]
    if tallies:
        found = reliability([(tally, _chance) for tally in tallies.values()])
        figures['reliability'] = {'calibration_error': calibration_error(found),
                                  **{name: values.tolist() for name, values in found._asdict().items()}}
    return figures


def _curve(tallies: Mapping[str, Tally]) -> dict[str, Any]:
    """Means of the scenes, each of which keeps its surest pixels. Nothing where the method has no confidence."""
    if not tallies:
        return {}
    aucs = {name: auc(tally) for name, tally in tallies.items()}
    areas = {name: area(tally) for name, tally in tallies.items()}
    known = [value for value in aucs.values() if not math.isnan(value)]
    return {
        'auc': float(np.mean(known)) if known else None, 'area': float(np.mean(list(areas.values()))),
        'coverage': list(COVERAGES),
        'wrong': np.mean([wrong_at(tally, COVERAGES) for tally in tallies.values()], axis=0).tolist(),
        'scenes': {name: {'auc': None if math.isnan(value) else value, 'area': areas[name]}
                   for name, value in aucs.items()},
    }


def _chance(confidence: Numbers) -> Numbers:
    return chance_wrong(confidence).astype(np.float64)
