"""Runs matchers over scenes and judges what they give."""
from __future__ import annotations

import dataclasses
import math
import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import cv2
import numpy as np

from ..kernels.arrays import Bool, Float32
from ..matcher import StereoMatcher
from ..parameters import MatcherParameters
from .datasets import StereoScene
from .metrics import METRICS, error_metrics, weighted_average
from .opencv_matchers import OPENCV_METHODS, OpenCVMatcher, settings_of
from .streaks import streak_share
from .trust_curves import kept_and_wrong

OWN_METHOD = 'svdm'
METHODS = (OWN_METHOD, *OPENCV_METHODS)
REGIONS = ('nonocc', 'all')
SCENE_METRICS = (*METRICS, 'valid', 'kept', 'kept_wrong')  # each of them for each region
LEAST_CONFIDENCE = 0.2
"""Of the pixels that count as kept."""
WRONG = 1.0
"""px of the images matched: a disparity that is off by more is wrong, as in `chance_wrong`."""


class Answer(NamedTuple):
    """disparity: float32 (H, W), px, dense. valid: bool (H, W), what the method vouches for. confidence: float32
    (H, W), 0 .. 1, None where the method has none."""

    disparity: Float32
    valid: Bool
    confidence: Float32 | None

    @property
    def trust(self) -> Float32:
        """The confidence; where there is none, 1 where it is valid and 0 elsewhere."""
        return self.valid.astype(np.float32) if self.confidence is None else self.confidence


@dataclasses.dataclass(frozen=True, slots=True)
class JudgedScene:
    """answer: the method's. figures: '<metric>_<region>', streaks, time_ms and num_disparities, as in `judge`."""

    answer: Answer
    figures: dict[str, float]


class Contender:
    """One of METHODS, to be run over scenes of any size.

    parameters: those of svdm. num_disparities: searched in every scene, px; None takes what the scene says.
    threads: 0 for one a processor. ValueError where `method` is unknown.
    """

    def __init__(
        self, method: str, parameters: MatcherParameters, num_disparities: int | None = None, threads: int = 0
    ) -> None:
        if method not in METHODS:
            raise ValueError(f'method {method!r} is not allowed: it must be {" | ".join(METHODS)}')
        self.method = method
        self._parameters = parameters
        self._num_disparities = num_disparities
        self._threads = threads
        self._own = StereoMatcher(parameters, threads)

    @property
    def settings(self) -> dict[str, Any]:
        """What it runs with; without num_disparities where that comes from the scene."""
        if self.method != OWN_METHOD:
            return {'opencv': cv2.__version__, 'settings': settings_of(self.method)}
        given = self._parameters.as_dict()
        if self._num_disparities is None:
            del given['num_disparities']
        return given

    def judge(self, scene: StereoScene, factor: float) -> JudgedScene:
        """Match `scene` and judge the dense map. factor: full-resolution px per px of its images.

        Figures: METRICS for nonocc (pixels that both views see) and all, over known ground truth; valid, the % of
        these pixels that the matcher itself vouches for before it fills (left-right check; OpenCV's own answer). kept,
        the % with a confidence of LEAST_CONFIDENCE or more, for OpenCV the same as valid; kept_wrong, the % of these
        off by more than WRONG px of the images matched, 0 where none is kept. streaks, % of the map: see
        `streak_share`. time_ms is of this one frame, filling included. Raises ValueError where the method cannot match
        the scene.
        """
        num_disparities = self._num_disparities or scene.num_disparities
        self._warm_up(scene, num_disparities)
        start = time.perf_counter()
        try:
            answer = self._match(scene, num_disparities)
        except cv2.error as error:
            raise ValueError(f'{scene.name}: {self.method} cannot match it: {error.err}') from None
        milliseconds = 1e3 * (time.perf_counter() - start)
        figures = scene_figures(answer, scene, factor)
        return JudgedScene(answer, {**figures, 'streaks': streak_share(answer.disparity, scene.left),
                                    'time_ms': milliseconds, 'num_disparities': num_disparities})

    def _warm_up(self, scene: StereoScene, num_disparities: int) -> None:
        """Compile what the scene needs before its time is taken."""
        if self.method == OWN_METHOD:
            self._own.parameters = self._parameters.replace(num_disparities=num_disparities)
            if self._own.not_compiled(scene.left):
                self._own.compute(scene.left[:8, :12], scene.right[:8, :12])

    def _match(self, scene: StereoScene, num_disparities: int) -> Answer:
        if self.method == OWN_METHOD:
            self._own.parameters = self._parameters.replace(num_disparities=num_disparities)
            result = self._own.compute(scene.left, scene.right)
            return Answer(result.disparity, result.valid, result.confidence)
        cv2.setNumThreads(self._threads or -1)  # -1 is OpenCV's own choice; 0 would be one thread
        channels = 1 if scene.left.ndim == 2 else scene.left.shape[2]
        matcher = OpenCVMatcher(self.method, num_disparities, channels)
        return Answer(*matcher.compute_filled(scene.left, scene.right), None)


def known_pixels(scene: StereoScene) -> dict[str, Bool]:
    """Region -> bool (H, W), the pixels of known ground truth in it."""
    known = np.isfinite(scene.ground_truth)
    return {'nonocc': known & scene.nonocc, 'all': known}


def scene_figures(answer: Answer, scene: StereoScene, factor: float) -> dict[str, float]:
    """'<metric>_<region>' -> value, as in `Contender.judge`."""
    figures = {}
    for region, known in known_pixels(scene).items():
        metrics = error_metrics(answer.disparity, scene.ground_truth, known, factor)
        metrics['valid'] = 100 * float(answer.valid[known].mean())
        chosen = answer.trust[known] >= LEAST_CONFIDENCE
        metrics['kept'], metrics['kept_wrong'] = kept_and_wrong(chosen, wrong_pixels(answer, scene, known, WRONG))
        figures.update({f'{name}_{region}': metrics[name] for name in SCENE_METRICS})
    return figures


def wrong_pixels(answer: Answer, scene: StereoScene, known: Bool, most: float) -> Bool:
    """bool (N,), of the pixels `known`: those off by more than `most` px of the images matched."""
    error = np.abs(answer.disparity[known].astype(np.float64) - scene.ground_truth[known])
    return ~(error <= most)


@dataclasses.dataclass(frozen=True, slots=True)
class Evaluation:
    """figures: method -> scene -> figures of the scenes that all methods matched; failures: a line for each other."""

    figures: dict[str, dict[str, dict[str, float]]]
    failures: list[str]


def evaluate(
    scenes: Mapping[str, Callable[[], StereoScene]],
    contenders: Sequence[Contender],
    factor: float,
    tell: Callable[[str], None] = lambda _: None,
    on_scene: Callable[[StereoScene, Mapping[str, JudgedScene]], None] = lambda _scene, _judged: None,
) -> Evaluation:
    """Run every contender over every scene. scenes: name -> what reads it. factor: as in `Contender.judge`.

    `tell` is given each scene's name before it is read, `on_scene` each scene with what was made of it. Raises
    ValueError where no scene is left, and where a figure is not a number.
    """
    result = Evaluation({contender.method: {} for contender in contenders}, [])
    for name, read in scenes.items():
        tell(name)
        try:
            scene = read()
            judged = {contender.method: contender.judge(scene, factor) for contender in contenders}
        except (ValueError, OSError) as error:
            result.failures.append(str(error))
            continue
        for method, one in judged.items():
            _check_numbers(f'{method} on {name}', one.figures)
            result.figures[method][name] = one.figures
        on_scene(scene, judged)
    if len(result.failures) == len(scenes):
        more = f' (and none of the other {len(scenes) - 1} scenes could be evaluated)' if len(scenes) > 1 else ''
        raise ValueError(f'{result.failures[0]}{more}')
    return result


def summary(scenes: Mapping[str, Mapping[str, float]], weights: Mapping[str, float]) -> dict[str, Any]:
    """{'scenes': the figures, 'weighted': their average}; num_disparities is not averaged."""
    weighted = weighted_average(scenes, weights)
    del weighted['num_disparities']
    return {'scenes': {name: dict(figures) for name, figures in scenes.items()}, 'weighted': weighted}


def _check_numbers(what: str, figures: Mapping[str, float]) -> None:
    for name, value in figures.items():
        if not math.isfinite(value):
            raise ValueError(f'{what}: {name} is {value}; nothing was written')


def parse_methods(texts: Sequence[str]) -> list[str]:
    """Methods given one by one or separated by commas, each once. ValueError names an unknown one."""
    names = list(dict.fromkeys(name.strip() for text in texts for name in text.split(',')))
    for name in names:
        if name not in METHODS:
            raise ValueError(f'method {name!r} is not allowed: it must be {" | ".join(METHODS)}')
    return names
