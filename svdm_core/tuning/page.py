"""A study as one HTML page that needs no other file."""
from __future__ import annotations

import base64
from importlib.resources import files
from typing import Any

import jinja2

from ..evaluation import streaks
from ..evaluation.aligned_scenes import alignment_line
from .optimization import FIGURES, Step
from .pictures import draw_image, draw_map, draw_step, draw_trials
from .report import HEADINGS, Study, document, paper_table, path

MAP_SCENES = ('Adirondack', 'MotorcycleE', 'Recycle')  # those of the paper's Figure 1
_SHOWN_TRIALS = 20

_TEMPLATE = 'templates/tuning.html.jinja'


def page(study: Study) -> str:
    """The page; maps of up to three scenes along the way are matched anew."""
    found = document(study)
    way = path(study)
    steps = [_step(entry, step, study) for entry, step in zip(found['steps'], study.steps, strict=True)]
    different = {_listed(trial['values']): trial['average'] for trial in found['trials']}
    ranked = sorted(different.items(), key=lambda item: float(item[1][study.objective]))[:_SHOWN_TRIALS]
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string(files(__package__).joinpath(_TEMPLATE).read_text(encoding='utf-8'))
    return template.render(
        scenes=found['scenes'], rows=alignment_line(study.row_alignment) if study.row_alignment else '',
        objective=study.objective, names=FIGURES, headings=HEADINGS,
        way=[(label, evaluation.average, False) for label, evaluation in way],
        changed=found['changed'], steps=steps, streak=streaks, trial_count=len(study.trials),
        trials=[(label, average, False) for label, average in ranked], different=len(different),
        trials_picture=_uri(draw_trials(study.trials, study.varied, study.objective), 'png') if study.trials else '',
        streak_rows=[(label, {name: figures['streaks'] for name, figures in evaluation.scenes.items()})
                     for label, evaluation in way],
        maps=_maps(study), start=_own(found['start']), best=_own(found['best']))


def _step(entry: dict[str, Any], step: Step, study: Study) -> dict[str, Any]:
    table = paper_table(step) if study.against_paper else None
    rows = [(value, figures, value == step.best_value)
            for value, figures in zip(entry['values'], entry['figures'], strict=True)]
    picture = _uri(draw_step(step, table), 'png') if len(rows) > 1 else ''
    return {**entry, 'rows': rows, 'picture': picture}


def _maps(study: Study) -> list[tuple[str, list[tuple[str, str]]]]:
    """A row of pictures a scene: the left image, and the maps along the way."""
    scenes = [scene for scene in study.evaluate.scenes if scene.name in MAP_SCENES] or study.evaluate.scenes[:3]
    rows = []
    for scene in scenes:
        cells = [('left image', _uri(draw_image(scene.left), 'jpeg'))]
        for label, evaluation in path(study):
            disparity = study.evaluate.disparity(scene, evaluation.parameters)
            cells.append((label, _uri(draw_map(disparity, scene.left, scene.num_disparities), 'jpeg')))
        rows.append((scene.name, cells))
    return rows


def _own(evaluation: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in evaluation['parameters'].items()
            if name not in ('min_disparity', 'num_disparities')}


def _listed(values: dict[str, Any]) -> str:
    return ', '.join(f'{name} {value}' for name, value in values.items())


def _uri(data: bytes, kind: str) -> str:
    return f'data:image/{kind};base64,{base64.b64encode(data).decode()}'
