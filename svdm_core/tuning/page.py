"""A study as one HTML page that needs no other file."""
from __future__ import annotations

import base64
from importlib.resources import files
from typing import Any

import jinja2

from ..evaluation import streaks
from ..evaluation.aligned_scenes import alignment_line
from .optimization import Step
from .pictures import draw_image, draw_importances, draw_map, draw_step, draw_trials
from .report import Study, document, paper_table, path, verdict

MAP_SCENES = ('Adirondack', 'MotorcycleE', 'Recycle')  # those of the paper's Figure 1
_SHOWN_TRIALS = 20

_TEMPLATE = 'templates/tuning.html.jinja'


def page(study: Study) -> str:
    """The page; maps of up to three scenes along the way are matched anew."""
    found = document(study)
    way = path(study)
    steps = [_step(entry, step, study) for entry, step in zip(found['steps'], study.steps, strict=True)
             if step.improved or not study.climbed]
    bars = draw_importances(study.importances, study.headings[study.objective]) if study.importances else b''
    different = {_listed(trial['values']): trial['average'] for trial in found['trials']}
    ranked = sorted(different.items(), key=lambda item: float(item[1][study.objective]))[:_SHOWN_TRIALS]
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string(files(__package__).joinpath(_TEMPLATE).read_text(encoding='utf-8'))
    return template.render(
        scenes=found['scenes'], rows=alignment_line(study.row_alignment) if study.row_alignment else '',
        explanation=study.evaluate.judge.explanation, notes=study.notes,
        verdict='' if study.importances else verdict(study),
        importances=_uri(bars, 'png') if bars else '', objective=study.objective, names=list(study.headings),
        headings=study.headings,
        way=[(label, evaluation.average, False) for label, evaluation in way],
        steps=steps, steps_in_vain=_in_vain(study), streak=streaks, trial_count=len(study.trials),
        trials=[(label, average, False) for label, average in ranked], different=len(different),
        trials_picture=_uri(draw_trials(study.trials, study.varied, study.objective), 'png') if study.trials else '',
        streak_rows=[(label, {name: figures['streaks'] for name, figures in evaluation.scenes.items()})
                     for label, evaluation in way],
        maps=_maps(study), start=_own(found['start']), best=_own(found['best']))


def _step(entry: dict[str, Any], step: Step, study: Study) -> dict[str, Any]:
    table = paper_table(step) if study.against_paper else None
    rows = [(value, figures, value == step.best_value)
            for value, figures in zip(entry['values'], entry['figures'], strict=True)]
    picture = _uri(draw_step(step, study.evaluate.judge.plots, table), 'png') if len(rows) > 1 else ''
    return {**entry, 'rows': rows, 'picture': picture}


def _maps(study: Study) -> list[tuple[str, list[tuple[str, str]]]]:
    """A row of pictures a scene: the left image, and the maps along the way."""
    scenes = [scene for scene in study.evaluate.scenes if scene.name in MAP_SCENES] or study.evaluate.scenes[:3]
    shown = [('start', study.start), ('best', study.best)] if study.climbed else path(study)
    rows = []
    for scene in scenes:
        cells = [('left image', _uri(draw_image(scene.left), 'jpeg'))]
        for label, evaluation in shown:
            disparity = study.evaluate.result(scene, evaluation.parameters).disparity
            cells.append((label, _uri(draw_map(disparity, scene), 'jpeg')))
        rows.append((scene.name, cells))
    return rows


def _in_vain(study: Study) -> str:
    """The parameters of which no step was better, where that is many."""
    better = {step.range.name for step in study.steps if step.improved}
    tried = dict.fromkeys(step.range.name for step in study.steps if step.range.name not in better)
    return ', '.join(tried) if study.climbed else ''


def _own(evaluation: dict[str, Any]) -> dict[str, Any]:
    return {name: value for name, value in evaluation['parameters'].items()
            if name not in ('min_disparity', 'num_disparities')}


def _listed(values: dict[str, Any]) -> str:
    return ', '.join(f'{name} {value}' for name, value in values.items())


def _uri(data: bytes, kind: str) -> str:
    return f'data:image/{kind};base64,{base64.b64encode(data).decode()}'
