"""A study as one HTML page that needs no other file."""
from __future__ import annotations

import base64
from typing import Any

import jinja2

from ..evaluation import streaks
from .optimization import FIGURES, Step
from .pictures import draw_image, draw_map, draw_step, draw_trials
from .report import HEADINGS, Study, document, paper_table, path

MAP_SCENES = ('Adirondack', 'MotorcycleE', 'Recycle')  # those of the paper's Figure 1
_SHOWN_TRIALS = 20

_TEMPLATE = '''<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>svdm tune</title><style>
body { font: 15px/1.5 system-ui, sans-serif; max-width: 1180px; margin: 2em auto; padding: 0 1em; color: #222 }
table { border-collapse: collapse; margin: 0.7em 0; font-size: 13px }
td, th { padding: 2px 9px; text-align: right; border-bottom: 1px solid #ddd }
td:first-child, th:first-child { text-align: left }
img { max-width: 100%; display: block }
code { background: #f2f2f2 }
.best { font-weight: bold; background: #eef6ee }
.differs { background: #fff5e0; padding: 0.5em 0.8em }
.maps td { padding: 2px; text-align: center; border: 0 }
</style></head><body>
{%- macro figures_table(rows, first) %}
<table><tr><th>{{ first }}</th>
{%- for name in names %}<th>{{ headings[name] }}</th>{% endfor %}</tr>
{%- for label, figures, best in rows %}
<tr{% if best %} class="best"{% endif %}><td>{{ label }}</td>
{%- for name in names %}<td>{{ '%.3f'|format(figures[name]) }}</td>{% endfor %}</tr>
{%- endfor %}</table>
{%- endmacro %}
<h1>Parameters tuned</h1>
<p>{{ scenes|length }} scenes: {{ scenes|join(', ') }}. Errors are in px of the full resolution, averaged with the
weights of Middlebury v3. Chosen by {{ headings[objective] }}: the smallest, the first among equals.</p>
{{ figures_table(way, 'after') }}
<p>Best: {% for name, value in changed.items() %}<code>{{ name }} = {{ value }}</code>{{ ', ' if not loop.last }}
{%- else %}as at the start{% endfor %}.</p>
{%- for step in steps %}
<h2>{{ step.parameter }}</h2>
{%- if step.differs_from_paper %}
<p class="differs">Differs from the paper's Table {{ step.paper.number }}: {{ step.differs_from_paper }}.</p>
{%- endif %}
{%- if not step.improved %}
<p>No value was better than {{ step.best_value }}, which is kept.</p>
{%- endif %}
{%- if step.picture %}
<img alt="figures over {{ step.parameter }}" src="{{ step.picture }}">
{%- endif %}
<details><summary>Table</summary>{{ figures_table(step.rows, step.parameter) }}</details>
{%- endfor %}
{%- if trials %}
<h2>Joint search, {{ trial_count }} trials</h2>
<p>{{ different }} of them different: the sampler comes back to what is good, which costs nothing.</p>
<img alt="figures of the trials" src="{{ trials_picture }}">
<p>The best {{ trials|length }}:</p>{{ figures_table(trials, 'values') }}
{%- endif %}
<h2>Streaks</h2>
<p>Share of the pixels in horizontal runs of at least {{ streak.LENGTH }} px of layers at most {{ streak.THICKNESS }}
rows thick that differ by more than {{ '%g'|format(streak.DISPARITY_STEP) }} px from what is above and below, nearer
than both or farther than both, with no step of the image above {{ streak.IMAGE_STEP }} grey levels at their upper and
lower end. No ground truth is needed. In the maps they are red.</p>
<table><tr><th>streaks %</th>{% for label, _ in streak_rows %}<th>{{ label }}</th>{% endfor %}</tr>
{%- for scene in scenes %}
<tr><td>{{ scene }}</td>
{%- for _, values in streak_rows %}<td>{{ '%.3f'|format(values[scene]) }}</td>{% endfor %}</tr>
{%- endfor %}</table>
<table class="maps">
{%- for scene, cells in maps %}
<tr>
{%- for label, picture in cells %}
<td><img alt="{{ scene }}, {{ label }}" src="{{ picture }}">{{ scene }}, {{ label }}</td>
{%- endfor %}</tr>
{%- endfor %}</table>
<h2>Best parameters</h2>
<table><tr><th>parameter</th><th>start</th><th>best</th></tr>
{%- for name, value in best.items() %}
<tr{% if value != start[name] %} class="best"{% endif %}><td>{{ name }}</td><td>{{ start[name] }}</td>
<td>{{ value }}</td></tr>
{%- endfor %}</table>
</body></html>
'''


def page(study: Study) -> str:
    """The page; maps of up to three scenes along the way are matched anew."""
    found = document(study)
    way = path(study)
    steps = [_step(entry, step, study) for entry, step in zip(found['steps'], study.steps, strict=True)]
    different = {_listed(trial['values']): trial['average'] for trial in found['trials']}
    ranked = sorted(different.items(), key=lambda item: float(item[1][study.objective]))[:_SHOWN_TRIALS]
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    return environment.from_string(_TEMPLATE).render(
        scenes=found['scenes'], objective=study.objective, names=FIGURES, headings=HEADINGS,
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
