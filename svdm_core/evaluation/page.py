"""An evaluation as one HTML page that needs no other file: tables, and pictures of every scene."""
from __future__ import annotations

import base64
import dataclasses
from collections.abc import Mapping, Sequence
from importlib.resources import files
from typing import Any

import cv2
import jinja2
import numpy as np

from ..files.colour_maps import DISPARITY_COLOURS, ERROR_COLOURS, colour_map, shown_range
from ..kernels.arrays import Image
from .aligned_scenes import alignment_line
from .datasets import StereoScene
from .metric_names import OF_THE_MAP, REGION_TITLES, larger_is_better, unit, written
from .metrics import weighted_average
from .paper import PAPER_AVGERR
from .scene_evaluation import REGIONS, JudgedScene
from .trust_pictures import draw_trust
from .trust_report import THRESHOLDS, written_auc

PAPER = 'paper'
TRUST_COVERAGES = (100, 80, 50)
"""%, of the table of confidences."""
_TEMPLATE = 'templates/evaluation.html.jinja'
_WIDTH = 800  # px, most that a picture takes
_UNKNOWN = (128, 128, 128)
_RESOLUTION_NAMES = {'Q': 'quarter', 'H': 'half', 'F': 'full'}


@dataclasses.dataclass(frozen=True, slots=True)
class Picture:
    """source: a data URI. low, high: what the ends of the colour bar mean, px; '' for a photograph."""

    title: str
    source: str
    low: str = ''
    high: str = ''
    bar: str = ''


@dataclasses.dataclass(frozen=True, slots=True)
class Cell:
    """One figure of a table; best of its row or column, or not."""

    text: str
    best: bool = False


class EvaluationPage:
    """Collects the pictures scene by scene, as they are matched, and renders the page at the end.

    factor: full-resolution px per px of the images.
    """

    def __init__(self, factor: int) -> None:
        self._factor = factor
        self._error_end = max(8, 4 * factor)  # px of full resolution at which the error map ends
        self._scenes: dict[str, list[Picture]] = {}

    def add(self, scene: StereoScene, judged: Mapping[str, JudgedScene]) -> None:
        """Keep the pictures of a scene: left image, ground truth, and of each method disparity and errors."""
        low, high = shown_range(scene.ground_truth)
        pictures = [Picture('left image', _data_uri(scene.left)),
                    self._disparity('ground truth', scene.ground_truth, low, high)]
        for method, result in judged.items():
            pictures.append(self._disparity(f'{method}: disparity', result.answer.disparity, low, high))
            error = self._factor * np.abs(result.answer.disparity - scene.ground_truth)
            figures = ', '.join(f'{result.figures[f"avgerr_{region}"]:.2f} px {region}' for region in REGIONS)
            pictures.append(Picture(
                f'{method}: error (avgerr {figures})',
                _data_uri(colour_map(error, 0, self._error_end, ERROR_COLOURS, _UNKNOWN)),
                '0 px', f'{self._error_end} px or more', _gradient(ERROR_COLOURS)))
        self._scenes[scene.name] = pictures

    def render(
        self, document: Mapping[str, Any], methods: Mapping[str, Any], metrics: Sequence[str],
        weights: Mapping[str, float],
    ) -> str:
        """The page. document: as --json writes it; methods: its part of each method; weights: of the scenes."""
        environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True,
                                         lstrip_blocks=True)
        template = environment.from_string(files(__package__).joinpath(_TEMPLATE).read_text(encoding='utf-8'))
        columns = [*methods, *([PAPER] if document['layout'] == 'Middlebury' else [])]
        found = document['row_alignment']
        return template.render(
            document=document, rows=alignment_line(found) if found else '', methods=methods,
            columns=columns, scenes=self._scenes, regions=REGION_TITLES,
            resolution=_RESOLUTION_NAMES[document['resolution']], by_scene=_by_scene(methods, columns, weights),
            thresholds=THRESHOLDS, coverages=TRUST_COVERAGES,
            metrics=[(metric.removesuffix('_ms'), unit(metric)) for metric in _shown(metrics)],
            averages={region: _averages(methods, _shown(metrics), region) for region in REGIONS},
            trust={region: _trust(methods, region) for region in REGIONS},
            curves={region: _png_uri(draw_trust(methods, region)) for region in REGIONS})

    def _disparity(self, title: str, disparity: Image, low: float, high: float) -> Picture:
        colours = colour_map(disparity, low, high, DISPARITY_COLOURS, _UNKNOWN)
        return Picture(title, _data_uri(colours), f'{low:g} px', f'{high:g} px',
                       _gradient(DISPARITY_COLOURS))


def _shown(metrics: Sequence[str]) -> list[str]:
    return [*metrics, *(['valid'] if 'valid' not in metrics else []), *OF_THE_MAP]


def _by_scene(
    methods: Mapping[str, Any], columns: Sequence[str], weights: Mapping[str, float]
) -> dict[str, dict[str, list[Cell]]]:
    """Row -> region -> cells in the order of `columns`: avgerr of each scene, and the weighted average as last row."""
    names = list(next(iter(methods.values()))['scenes'])
    paper: dict[str, dict[str, float]] = {name: PAPER_AVGERR[name] for name in names if name in PAPER_AVGERR}
    # Its average over the scenes of this run; none where it lacks one of them.
    average = weighted_average(paper, weights) if len(paper) == len(names) else {}
    rows: dict[str, dict[str, list[Cell]]] = {}
    for row in [*names, 'weighted average']:
        rows[row] = {}
        for region in REGIONS:
            own = {name: (method['scenes'].get(row) or method['weighted'])[f'avgerr_{region}']
                   for name, method in methods.items()}
            value = paper.get(row, {} if row in names else average).get(region)
            rows[row][region] = _cells('avgerr', [own.get(name, value) for name in columns])
    return rows


def _averages(methods: Mapping[str, Any], metrics: Sequence[str], region: str) -> dict[str, list[Cell]]:
    """Method -> its weighted averages; the best method of each metric is marked."""
    columns = []
    for metric in metrics:
        key = metric if metric in OF_THE_MAP else f'{metric}_{region}'
        columns.append(_cells(metric, [method['weighted'][key] for method in methods.values()]))
    return {name: [column[number] for column in columns] for number, name in enumerate(methods)}


def _trust(methods: Mapping[str, Any], region: str) -> dict[str, list[str]]:
    """Method -> for each threshold: kept by its own check and wrong of it, wrong of the surest, area, AUC; then the
    calibration error."""
    rows = {}
    for name, method in methods.items():
        figures, row = method['confidence'][region], []
        for threshold in THRESHOLDS:
            found = figures[f'wrong_by_{threshold}px']
            row += [f'{found["own_check"]["kept"]:.1f}', f'{found["own_check"]["wrong"]:.1f}']
            row += ([*(f'{found["wrong"][coverage - 1]:.1f}' for coverage in TRUST_COVERAGES), f'{found["area"]:.2f}',
                     written_auc(found['auc'])] if 'wrong' in found else ['-'] * (len(TRUST_COVERAGES) + 2))
        error = figures['reliability']['calibration_error'] if 'reliability' in figures else None
        rows[name] = [*row, '-' if error is None else f'{error:.3f}']
    return rows


def _cells(metric: str, values: Sequence[float | None]) -> list[Cell]:
    """Figures as texts; what reads the same as the best is best too, and one alone is not."""
    texts = ['-' if value is None else written(metric, value) for value in values]
    known = {text: float(text) for text in texts if text != '-'}
    if len(known) < 2:
        return [Cell(text) for text in texts]
    best = (max if larger_is_better(metric) else min)(known.values())
    return [Cell(text, known.get(text) == best) for text in texts]


def _data_uri(image: Image) -> str:
    """A JPEG of at most _WIDTH px width inside the address itself."""
    height, width = image.shape[:2]
    if width > _WIDTH:
        image = np.asarray(cv2.resize(image, (_WIDTH, round(height * _WIDTH / width)), interpolation=cv2.INTER_AREA))
    jpeg = cv2.imencode('.jpg', image, [cv2.IMWRITE_JPEG_QUALITY, 88])[1].tobytes()
    return f'data:image/jpeg;base64,{base64.b64encode(jpeg).decode()}'


def _png_uri(png: bytes) -> str:
    return f'data:image/png;base64,{base64.b64encode(png).decode()}'


def _gradient(colours: int) -> str:
    """The colour map from left to right, for CSS."""
    stops = cv2.applyColorMap(np.linspace(0, 255, 12).astype(np.uint8)[None], colours)[0]
    return f'linear-gradient(to right, {", ".join(f"rgb({r}, {g}, {b})" for b, g, r in stops.tolist())})'
