"""The page: pictures and figures as they come, parameters as they are moved."""
from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from functools import partial
from importlib.resources import files
from typing import Any

from nicegui import run, ui

from svdm_core.shown import line

from ..node.parameter_set import NodeParameters, Value
from .comparison import Compared, Comparison
from .control_row import ControlRow
from .controls import Control, controls, groups
from .pictures import (
    Picture,
    as_uri,
    confidence_picture,
    difference_picture,
    disparity_picture,
    error_picture,
    left_picture,
)
from .shot import Shot
from .tuning_session import TuningSession

_TICK = 0.05
"""s between two looks whether there is something new."""
_PATIENCE = 2.0
"""s for the browser to have shown a picture; then the next is sent all the same."""
_TITLES = {'matching_cost': '1 matching cost', 'cost_aggregation': '2 cost aggregation',
           'disparity_optimization': '3 disparity optimisation', 'disparity_refinement': '4 disparity refinement'}


class Page:
    """One browser's view of the session. For the event loop's thread; whatever takes time is done in others."""

    def __init__(self, session: TuningSession) -> None:
        self._session = session
        self._rows: dict[str, ControlRow] = {}
        self._pictures: dict[str, Any] = {}
        self._labels: dict[str, Any] = {}
        self._seen, self._waits_since = 0, 0.0
        self._shown: tuple[int, Mapping[str, Value]] = (-1, {})
        self._moves: dict[str, Value] = {}
        self._moving = False
        self._compared: tuple[Comparison, NodeParameters] | None = None

    def build(self) -> None:
        """Put all of it on the page, and begin to look for what is new."""
        ui.add_css(files(__package__).joinpath('page.css').read_text(encoding='utf-8'))
        with ui.element('div').classes('tuner'):
            with ui.element('div').classes('seen'):
                self._build_head()
                self._build_pictures()
                self._build_comparison()
                self._figures = ui.element('div').classes('figures')
            with ui.element('div').classes('moved'):
                self._build_buttons()
                self._build_controls()
        ui.timer(_TICK, self._tick)

    # What is on it

    def _build_head(self) -> None:
        source = self._session.source
        with ui.element('div').classes('bar'):
            ui.label(source.title).classes('title')
            if source.plays:
                self._play = ui.button('pause', on_click=self._toggle).props('dense flat no-caps')
                ui.button('step', on_click=source.step).props('dense flat no-caps')
            self._third = ui.toggle({'confidence': 'confidence', 'error': 'error'}, value='confidence',
                                    on_change=self._draw_anew).props('dense no-caps flat')
            self._third.set_visibility(False)
        self._trouble = ui.label().classes('trouble')

    def _build_pictures(self) -> None:
        with ui.element('div').classes('pictures'):
            for name in ('left', 'disparity', 'third'):
                self._add_picture(name, 'confidence' if name == 'third' else name)
        self._pictures['disparity'].on('load', self._acknowledge, args=[])

    def _build_comparison(self) -> None:
        with ui.element('div').classes('comparison') as self._comparison:
            with ui.element('div').classes('pictures'):
                self._add_picture('A', 'A, held')
                self._add_picture('B', 'B, now, on the same pair')
                self._add_picture('difference', 'red: B is nearer than A by more than 1 px, blue: farther; dark: known '
                                                'in one')
            self._table = ui.element('div').classes('figures')
        self._comparison.set_visibility(False)

    def _add_picture(self, name: str, caption: str) -> None:
        with ui.element('figure'):
            self._pictures[name] = ui.element('img').props(f'alt="{name}"')
            with ui.element('figcaption'):
                self._labels[f'caption {name}'] = ui.label(caption)

    def _build_buttons(self) -> None:
        session = self._session

        async def done(action: Callable[[], str]) -> None:
            self._tell(await run.io_bound(action))

        with ui.element('div').classes('bar'):
            names = session.files.names()
            self._preset = ui.select(names, value=session.preset if session.preset in names else None).props(
                'dense options-dense aria-label="preset"').classes('preset')
            self._preset.on('popup-show', self._list_files)
            ui.button('load', on_click=lambda: done(lambda: session.load(str(self._preset.value)))).props(_BUTTON)
            ui.button('save', on_click=self._ask_name).props(_BUTTON)
            self._undo = ui.button('undo', on_click=lambda: done(session.undo)).props(_BUTTON)
            ui.button('reset', on_click=lambda: done(session.reset)).props(_BUTTON)
        with ui.element('div').classes('bar'):
            ui.button('hold as A', on_click=lambda: done(session.hold)).props(_BUTTON)
            self._back = ui.button('back to A', on_click=lambda: done(session.take_held)).props(_BUTTON)
            self._release = ui.button('let go', on_click=lambda: done(session.release)).props(_BUTTON)

    def _build_controls(self) -> None:
        for group, members in groups(controls()).items():
            with ui.element('section').classes('group'):
                ui.label(_TITLES.get(group, group)).classes('group-title')
                for control in members:
                    if not control.is_folded:
                        self._rows[control.name] = ControlRow(control, self._move)
                folded = [control for control in members if control.is_folded]
                if folded:
                    with ui.expansion(f'{len(folded)} more').props('dense dense-toggle'):
                        for control in folded:
                            self._rows[control.name] = ControlRow(control, self._move)

    # What the user does

    async def _move(self, control: Control, value: Value) -> None:
        """The newest value of each parameter; what is moved meanwhile waits."""
        self._moves[control.name] = value
        if self._moving:
            return
        self._moving = True
        try:
            while self._moves:
                name, wanted = self._moves.popitem()
                reason = await run.io_bound(self._session.move, name, wanted)
                self._rows[name].complain(reason or '')
                if reason:
                    self._show_values(at_once=name)
        finally:
            self._moving = False

    def _toggle(self) -> None:
        source = self._session.source
        source.play(on=not source.is_playing)

    def _list_files(self) -> None:
        self._preset.set_options(self._session.files.names(), value=self._preset.value)

    def _ask_name(self) -> None:
        with ui.dialog() as dialog, ui.card():
            ui.label(f'Save as a parameter file in {self._session.files.folder.absolute()}')
            name = ui.input('name', value='tuned.yaml').props('aria-label="file name"')
            replace = ui.checkbox('replace it if it exists')
            problem = ui.label().classes('problem')

            async def save() -> None:
                try:
                    path = await run.io_bound(self._session.save, str(name.value or ''), replace=bool(replace.value))
                except (ValueError, OSError) as error:
                    problem.set_text(str(error))
                    return
                dialog.close()
                ui.notify(f'{path} is written', type='positive')

            with ui.element('div').classes('bar'):
                ui.button('save file', on_click=save).props(_BUTTON)
                ui.button('cancel', on_click=dialog.close).props(_BUTTON)
        dialog.on('hide', dialog.delete)
        dialog.open()

    def _tell(self, reason: str | None) -> None:
        if reason:
            ui.notify(reason, type='negative', multi_line=True)
        self._show_values(at_once='all')

    # What is new

    async def _tick(self) -> None:
        session, source = self._session, self._session.source
        self._trouble.set_text(source.trouble())
        self._trouble.set_visibility(bool(source.trouble()))
        if source.plays:
            self._play.set_text('pause' if source.is_playing else 'play')
        self._undo.set_enabled(session.can_undo)
        for button in (self._back, self._release):
            button.set_visibility(session.comparison is not None)
        if (session.version, dict(source.values())) != self._shown:
            self._show_values()
        shot = source.latest()
        if shot is not None and shot.number != self._seen and self._is_ready():
            await self._draw(shot)
        self._list(self._figures, source.figures())
        await self._compare()

    def _show_values(self, at_once: str = '') -> None:
        """at_once: the name of a parameter whose value is to come back, or 'all'."""
        values, base, is_shown = self._session.source.values(), self._session.base, True
        for name, row in self._rows.items():
            row.element.set_visibility(name in values)
            if name in values:
                is_shown &= row.show(values[name], base.get(name), at_once=at_once in (name, 'all'))
        self._shown = self._session.version if is_shown else -1, dict(values)

    def _is_ready(self) -> bool:
        return not self._waits_since or time.monotonic() - self._waits_since > _PATIENCE

    def _acknowledge(self, _event: Any) -> None:
        self._waits_since = 0.0

    def _draw_anew(self, _event: Any) -> None:
        self._seen = 0

    async def _draw(self, shot: Shot) -> None:
        self._seen, self._waits_since = shot.number, time.monotonic()
        has_truth = shot.truth is not None
        if has_truth and not self._third.visible:
            self._third.set_value('error')
        self._third.set_visibility(has_truth)
        kind = str(self._third.value) if has_truth else 'confidence'
        self._labels['caption third'].set_text(_CAPTIONS[kind])
        draw = {'left': left_picture, 'disparity': disparity_picture,
                'third': error_picture if kind == 'error' else confidence_picture}
        await self._send({name: partial(make, shot) for name, make in draw.items()})

    async def _compare(self) -> None:
        """Match both sets on the pair that is held, where one of them, or the pair, is another than before."""
        comparison = self._session.comparison
        if comparison is None:
            self._compared = None
            self._comparison.set_visibility(False)
            return
        parameters = self._session.parameters()
        if self._compared == (comparison, parameters):
            return
        self._compared = comparison, parameters
        self._comparison.set_visibility(True)
        try:
            found: Compared | None = await run.io_bound(comparison.against, parameters)
        except Exception as error:  # whatever it is, A and B are not of these parameters
            self._list(self._table, {'not compared': line(error)})
            return
        if found is None:  # the page is closing
            return
        await self._send({'A': partial(disparity_picture, found.first), 'B': partial(disparity_picture, found.second),
                          'difference': partial(difference_picture, found.first, found.second)})
        figures = {name: f'{found.first_figures.get(name, "-")} | {value}'
                   for name, value in found.second_figures.items()}
        apart = {} if found.different is None else {'differ by more than 1 px': f'{found.different:.1f} %'}
        self._list(self._table, {'': 'A | B', **figures, **apart})

    async def _send(self, drawn: Mapping[str, Callable[[], Picture]]) -> None:
        sources = await run.io_bound(lambda: {name: as_uri(draw()) for name, draw in drawn.items()})
        for name, source in (sources or {}).items():
            if name == 'disparity' and source == self._pictures[name].props.get('src'):
                self._waits_since = 0.0  # the browser loads nothing anew, and tells of nothing
            self._pictures[name].props['src'] = source

    def _list(self, place: Any, figures: Mapping[str, str]) -> None:
        """Names and values as labels, made once and filled anew."""
        kept: dict[str, Any] = self._labels.setdefault(f'list {place.id}', {})
        if list(kept) != list(figures):
            place.clear()
            kept.clear()
            with place:
                for name in figures:
                    ui.label(name).classes('figure-name')
                    kept[name] = ui.label().classes('figure-value')
        for name, value in figures.items():
            kept[name].set_text(value)


_BUTTON = 'dense flat no-caps'
_CAPTIONS = {'confidence': 'confidence: white is 1',
             'error': 'error: red is too near, blue too far, white right, black unknown'}
