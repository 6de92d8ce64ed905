"""A proof as a document, as a table on the terminal and as a page."""
from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from importlib.resources import files
from typing import Any

import jinja2
import numpy as np
from matplotlib.figure import Figure
from rich.console import Console
from rich.table import Table

from .proof import BASES, TRUTHS, Proof

_GROUP_SIZES, _GROUP = (1, 3, 5, 8), 5
_FAMILIES = (*((base,) for base in BASES), ('paper_start', 'paper'))
_COLOURS = {'default': 'tab:blue', 'accurate': 'tab:cyan', 'fast': 'tab:green', 'paper': 'tab:orange',
            'paper_start': 'tab:red'}
_TEMPLATE = 'templates/proof.html.jinja'
_WIDTH = 140  # characters, where the output is no terminal


def document(proof: Proof) -> dict[str, Any]:
    """Everything found, of plain types."""
    left_out = proof.left_out('avgerr_nonocc')
    group = min(_GROUP, len(proof.scenes))
    sizes = [size for size in _GROUP_SIZES if size <= len(proof.scenes)]
    return {
        'scenes': proof.scenes,
        'sets': [{'base': one.base, 'parameters': one.parameters.as_dict(), 'loss': losses.tolist(),
                  **{name: proof.errors[name][row].tolist() for name in TRUTHS}}
                 for row, (one, losses) in enumerate(zip(proof.sets, proof.losses, strict=True))],
        'spearman': {name: dict(zip(proof.scenes, proof.correlations(name), strict=True)) for name in TRUTHS},
        'spearman_best_third': dict(zip(proof.scenes, proof.best_third('avgerr_nonocc'), strict=True)),
        'spearman_within': {base: float(np.mean(proof.within('avgerr_nonocc', base))) for base in BASES
                            if sum(one.base == base for one in proof.sets) > 2},
        'left_out': {scene: one._asdict() for scene, one in zip(proof.scenes, left_out, strict=True)},
        'regret': {str(size): {**proof.regret(size)._asdict(), 'left_out': proof.regret_left_out(size)}
                   for size in sizes},
        'group': group,
        'regret_within': {', '.join(bases): proof.regret(group, bases)._asdict()
                          for bases in _FAMILIES if {one.base for one in proof.sets} >= set(bases)},
    }


def print_proof(found: dict[str, Any]) -> None:
    """The figures of `document`."""
    console = Console()
    console = console if console.is_terminal else Console(width=_WIDTH)
    table = Table(title=f'rank correlation of loss and error over {len(found["sets"])} sets: '
                        f'{len(found["scenes"])} scenes')
    for heading in ('', 'mean', 'worst', 'worst scene'):
        table.add_column(heading, justify='left' if heading in ('', 'worst scene') else 'right')
    rows = [(name, found['spearman'][name]) for name in TRUTHS]
    rows.append(('avgerr_nonocc, best third of the sets', found['spearman_best_third']))
    if len(found['scenes']) > 1:
        rows.append(('avgerr_nonocc, weights from the other scenes',
                     {scene: entry['spearman'] for scene, entry in found['left_out'].items()}))
    for name, values in rows:
        worst = min(values, key=lambda scene: values[scene])
        table.add_row(name, f'{np.mean(list(values.values())):.3f}', f'{values[worst]:.3f}', worst)
    console.print(table)
    within = ', '.join(f'{base} {rho:.2f}' for base, rho in found['spearman_within'].items())
    console.print(f'avgerr_nonocc among the sets of one preset, mean over the scenes: {within}', soft_wrap=True)
    table = Table(title='avgerr nonocc above the best set, px, where one set is chosen')
    for heading in ('', 'by loss', 'weights from other scenes', 'the first kept', 'worst against the first kept'):
        table.add_column(heading, justify='right' if heading else 'left')
    for size, regret in found['regret'].items():
        table.add_row(f'all sets, on {size} pairs', *_cells(regret))
    for base, regret in found['regret_within'].items():
        table.add_row(f'those of {base}, on {found["group"]} pairs', *_cells(regret))
    console.print(table)


def proof_page(proof: Proof, found: dict[str, Any]) -> str:
    """One HTML page that needs no other file."""
    environment = jinja2.Environment(autoescape=True, undefined=jinja2.StrictUndefined)
    template = environment.from_string(files(__package__).joinpath(_TEMPLATE).read_text(encoding='utf-8'))
    picture = base64.b64encode(_scatter(proof)).decode()
    ranked = sorted(range(len(proof.sets)), key=lambda row: float(proof.losses[row].mean()))
    sets = [(proof.sets[row], float(proof.losses[row].mean()), float(proof.errors['avgerr_nonocc'][row].mean()))
            for row in ranked]
    return template.render(found=found, truths=TRUTHS, picture=f'data:image/png;base64,{picture}', sets=sets,
                           changed=_changed)


def _cells(regret: dict[str, float]) -> Sequence[str]:
    left_out = f'{regret["left_out"]:.2f}' if 'left_out' in regret else ''
    return f'{regret["chosen"]:.2f}', left_out, f'{regret["kept"]:.2f}', f'{regret["worst"]:+.2f}'


def _changed(one: Any) -> str:
    from ..presets import load_preset

    base = load_preset(one.base).as_dict()
    changes = {name: value for name, value in one.parameters.as_dict().items() if value != base[name]}
    return ', '.join(f'{name} {value:.4g}' if isinstance(value, float) else f'{name} {value}'
                     for name, value in changes.items())


def _scatter(proof: Proof) -> bytes:
    """A PNG: loss over error of all sets, a plot a scene."""
    columns = min(5, len(proof.scenes))
    rows = -(-len(proof.scenes) // columns)
    figure = Figure(figsize=(3 * columns, 2.6 * rows), layout='constrained')
    axes = list(figure.subplots(rows, columns, squeeze=False).flat)
    colours = [_COLOURS[one.base] for one in proof.sets]
    for scene, (ax, name) in enumerate(zip(axes, proof.scenes, strict=False)):
        ax.scatter(proof.errors['avgerr_nonocc'][:, scene], proof.losses[:, scene], c=colours, s=10)
        ax.set(title=name, xscale='log')
        ax.grid(alpha=0.3)
    for ax in axes[len(proof.scenes):]:
        ax.set_visible(False)
    figure.supxlabel('avgerr nonocc (px): ' + ', '.join(f'{base} {colour.removeprefix("tab:")}'
                                                        for base, colour in _COLOURS.items()))
    figure.supylabel('loss (%)')
    buffer = io.BytesIO()
    figure.savefig(buffer, format='png', dpi=90)
    return buffer.getvalue()
