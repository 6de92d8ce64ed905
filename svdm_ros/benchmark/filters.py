"""What the node's filters do to real pairs: how much they leave, how wrong that is, how it flickers, and their time.

python -m svdm_ros.benchmark.filters trainingQ [--street sequences/00] [--preset default]
"""
from __future__ import annotations

import argparse
import functools
import itertools
import json
import statistics
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from svdm_core import DisparityResult, StereoMatcher
from svdm_core.evaluation.datasets import StereoScene
from svdm_core.evaluation.metrics import error_metrics, weighted_average
from svdm_core.evaluation.scene_sets import RESOLUTIONS, SceneSet, find_scenes
from svdm_core.presets import load_preset, preset_names

from ..bags.images.image_files import find_pairs, read_pixels
from ..calibration.geometry import StereoGeometry
from ..frames.matched_frame import MatchedFrame
from ..frames.preparation import prepare
from ..frames.temporal_filter import TemporalFilter
from ..node.parameter_set import NodeParameters

_LEAVING_OUT: tuple[dict[str, Any], ...] = (
    {}, *({'confidence_threshold': least} for least in (0.1, 0.2, 0.3, 0.5)), {'publish_filled': False},
    {'speckle_size': 100}, {'speckle_size': 400}, {'confidence_threshold': 0.2, 'speckle_size': 100})
_TIMED: tuple[dict[str, Any], ...] = ({'confidence_threshold': 0.2}, {'speckle_size': 100})
_WEIGHTS = (0.0, 0.5, 0.8)
_GAIN, _OFFSET = 0.7, -10.0  # of the darkened right image
_NOISE, _NOISY_FRAMES = 2.0, 6  # grey levels; frames of a camera that stands
_STEADY = 1.0  # px; what changes by more from frame to frame is no flicker
_STREET_DISPARITIES = 128
_VGA, _ROUNDS = (640, 480), 30

Disparities = NDArray[np.float32]
Run = Callable[[StereoScene], dict[str, float]]


class Kept(NamedTuple):
    """Of the pixels that both views see: % kept; of these the mean error and the % off by more than 4, px of the full
    resolution."""

    kept: float
    avgerr: float
    bad4: float

    @classmethod
    def of(cls, disparity: Disparities, known: NDArray[np.bool_], scene: StereoScene, factor: float) -> Kept:
        found = error_metrics(np.where(known, disparity, np.nan), scene.ground_truth, scene.nonocc, factor)
        return cls(found['density'], found['avgerr'], 100 - 100 * (100 - found['bad4']) / found['density'])


class Bench:
    """A matcher with the parameters of a preset, over the scenes of a folder."""

    def __init__(self, scenes: SceneSet, preset: str) -> None:
        self._scenes, self._factor = scenes, RESOLUTIONS[scenes.resolution(None)]
        self._matcher = StereoMatcher(load_preset(preset))

    def leaving_out(self) -> Iterator[str]:
        """Rows of the filters that make pixels unknown."""
        def judge(scene: StereoScene) -> dict[str, float]:
            result = self._match(scene.left, scene.right, scene.num_disparities)
            return _numbered(Kept.of(result.disparity, _trusted(result, values), scene, self._factor)
                             for values in _LEAVING_OUT)

        for values, kept in zip(_LEAVING_OUT, self._averages(judge), strict=True):
            yield f'| {_told(values)} | {kept.kept:.1f} | {kept.avgerr:.2f} | {kept.bad4:.1f} |'

    def exposure(self) -> Iterator[str]:
        """Rows of exposure_match: right images as they are, and darkened."""
        cases = tuple(itertools.product((False, True), ('off', 'gain')))

        def judge(scene: StereoScene) -> dict[str, float]:
            return _numbered(self._exposed(scene, *case) for case in cases)

        for (darkened, setting), kept in zip(cases, self._averages(judge), strict=True):
            right = f'times {_GAIN:g}, {_OFFSET:+g}' if darkened else 'as it is'
            yield f'| {right} | `{setting}` | {kept.avgerr:.2f} | {kept.bad4:.1f} |'

    def standing(self) -> Iterator[str]:
        """Rows of temporal_filter where nothing moves and each frame has noise of its own: flicker, px; the error."""
        def judge(scene: StereoScene) -> dict[str, float]:
            random = np.random.default_rng(1)
            raw = [self._match(_noisy(scene.left, random), _noisy(scene.right, random), scene.num_disparities).disparity
                   for _ in range(_NOISY_FRAMES)]
            found: dict[str, float] = {}
            for weight, frames in _filtered(raw):
                every = np.ones(frames[-1].shape, np.bool_)
                found |= {f'{weight} flicker': _flicker(raw, frames),
                          f'{weight} avgerr': Kept.of(frames[-1], every, scene, self._factor).avgerr}
            return found

        found = self._average(judge)
        for weight in _WEIGHTS:
            yield f'| {weight:g} | {found[f"{weight} flicker"]:.3f} | {found[f"{weight} avgerr"]:.2f} |'

    def street(self, folder: Path) -> Iterator[str]:
        """Rows of temporal_filter on a sequence, from below folder/left and folder/right: flicker and lag, px."""
        pairs = find_pairs(folder / 'left', folder / 'right', None).pairs
        raw = [self._match(read_pixels(pair.left), read_pixels(pair.right), _STREET_DISPARITIES).disparity
               for pair in pairs]
        for weight, frames in _filtered(raw):
            lag = statistics.fmean(float(np.abs(one - other).mean()) for one, other in zip(raw, frames, strict=True))
            yield f'| {weight:g} | {_flicker(raw, frames):.3f} | {lag:.3f} |'

    def times(self) -> Iterator[str]:
        """Rows of the milliseconds a filter takes at 640x480, of which matching is no part."""
        scene = next(iter(self._scenes.readers.values()))()
        left, right = (np.asarray(cv2.resize(image, _VGA)) for image in (scene.left, scene.right))
        result = self._match(left, right, 64)
        every, temporal = np.ones(result.valid.shape, np.bool_), TemporalFilter()
        exposed = NodeParameters(exposure_match='gain')
        for values in _TIMED:
            yield f'| {_told(values)} | {_milliseconds(functools.partial(_trusted, result, values)):.2f} |'
        yield f'| `temporal_filter` | {_milliseconds(lambda: temporal(result.disparity, every, 0.5, 0.0, None)):.2f} |'
        yield f'| `exposure_match` | {_milliseconds(lambda: prepare(left, right, StereoGeometry(), exposed)):.2f} |'

    def _match(self, left: NDArray[Any], right: NDArray[Any], num_disparities: int) -> DisparityResult:
        self._matcher.parameters = self._matcher.parameters.replace(num_disparities=num_disparities)
        return self._matcher.compute(left, right)

    def _exposed(self, scene: StereoScene, darkened: bool, setting: str) -> Kept:
        right = scene.right
        if darkened:
            right = np.clip(np.rint(_GAIN * right.astype(np.float32) + _OFFSET), 0, 255).astype(np.uint8)
        pair = prepare(scene.left, right, StereoGeometry(), NodeParameters(exposure_match=setting))
        disparity = self._match(pair.left, pair.right, scene.num_disparities).disparity
        return Kept.of(disparity, np.ones(disparity.shape, np.bool_), scene, self._factor)

    def _average(self, run: Run) -> dict[str, float]:
        return weighted_average({name: run(read()) for name, read in self._scenes.readers.items()},
                                self._scenes.weights)

    def _averages(self, run: Run) -> list[Kept]:
        """Of what `_numbered` has made of several."""
        values = list(self._average(run).values())
        return [Kept(*part) for part in itertools.batched(values, len(Kept._fields))]


def main(arguments: list[str] | None = None) -> int:
    """Entry of the command: 0, or 2 with one line that says what is wrong."""
    parser = argparse.ArgumentParser(prog='filter_benchmark', description=str(__doc__).splitlines()[0])
    parser.add_argument('scenes', type=Path, help='folder of Middlebury scenes, as `svdm evaluate` takes it')
    parser.add_argument('--street', type=Path, metavar='FOLDER', help='a sequence: images in FOLDER/left and /right')
    parser.add_argument('--preset', choices=preset_names(), default='default', help='preset of the matcher (default)')
    options = parser.parse_args(arguments)
    try:
        _report(options)
    except (ValueError, OSError) as error:
        print(f'filter_benchmark: {error}', file=sys.stderr)
        return 2
    return 0


def _report(options: argparse.Namespace) -> None:
    bench = Bench(find_scenes(options.scenes), options.preset)
    _show('| filter | kept, % | avgerr of it, px | bad4 of it, % |', bench.leaving_out())
    _show('| right image | `exposure_match` | avgerr, px | bad4, % |', bench.exposure())
    _show('| `temporal_filter`, camera stands | flicker, px | avgerr, px |', bench.standing())
    if options.street is not None:
        _show('| `temporal_filter`, street | flicker, px | lag, px |', bench.street(options.street))
    _show('| filter | ms at 640x480 |', bench.times())


def _show(heading: str, rows: Iterator[str]) -> None:
    print(heading, '| --- ' * (heading.count('|') - 1) + '|', sep='\n')
    for row in rows:
        print(row, flush=True)
    print()


def _trusted(result: DisparityResult, values: dict[str, Any]) -> NDArray[np.bool_]:
    """What has a depth under these parameters; those that are not among them leave out nothing."""
    parameters = NodeParameters(**{'confidence_threshold': 0.0, **values})
    return MatchedFrame(None, np.empty(0, np.uint8), result.disparity, result.valid, result.confidence, result.step,
                        StereoGeometry(), parameters).trusted


def _numbered(kept: Iterator[Kept]) -> dict[str, float]:
    return {f'{number} {name}': value for number, one in enumerate(kept) for name, value in one._asdict().items()}


def _told(values: dict[str, Any]) -> str:
    return ', '.join(f'`{name}: {json.dumps(value)}`' for name, value in values.items()) or 'none'


def _noisy(image: NDArray[np.uint8], random: np.random.Generator) -> NDArray[np.uint8]:
    return np.clip(np.rint(image + random.normal(0, _NOISE, image.shape)), 0, 255).astype(np.uint8)


def _filtered(raw: Sequence[Disparities]) -> Iterator[tuple[float, list[Disparities]]]:
    """For each weight, the frames as they come out of the filter at 10 Hz."""
    every = np.ones(raw[0].shape, np.bool_)
    for weight in _WEIGHTS:
        temporal = TemporalFilter()
        yield weight, [temporal(frame, every, weight, 0.1 * number, None) for number, frame in enumerate(raw)]


def _flicker(raw: Sequence[Disparities], frames: Sequence[Disparities]) -> float:
    """px: the mean change of a pixel from frame to frame, where it is steady in the frames before the filter."""
    steady = [np.abs(after - before) <= _STEADY for before, after in itertools.pairwise(raw)]
    changes = [np.abs(after - before)[where]
               for (before, after), where in zip(itertools.pairwise(frames), steady, strict=True)]
    return float(np.concatenate(changes).mean())


def _milliseconds(work: Callable[[], object]) -> float:
    """The median of some rounds."""
    rounds = []
    for _ in range(_ROUNDS):
        start = time.perf_counter()
        work()
        rounds.append(1e3 * (time.perf_counter() - start))
    return statistics.median(rounds)


if __name__ == '__main__':
    sys.exit(main())
