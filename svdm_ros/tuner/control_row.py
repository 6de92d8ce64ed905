"""One parameter on the page: its name, a mark where it differs, what moves it, and why it was refused."""
from __future__ import annotations

import time
from collections.abc import Awaitable, Callable
from typing import Any

from nicegui import ui

from ..node.parameter_set import Value
from .controls import Control, written

_FRESH = 0.7
"""s after a move of the user's during which the page does not move the slider by itself: the hand is quicker."""

type Move = Callable[[Control, Value], Awaitable[None]]


class ControlRow:
    """Built where it is made. `show` is for values that come from elsewhere, and moves nothing."""

    def __init__(self, control: Control, move: Move) -> None:
        """move: what is done with a value that the user chose."""
        self.control = control
        self._move = move
        self._value: Value = control.info.default
        self._moved = 0.0
        self._showing = False
        with ui.element('div').classes('control').props(f'data-name={control.name}') as self.element:
            with ui.element('div').classes('head'):
                ui.label(control.name).classes('name')
                self._mark = ui.label('●').classes('mark')
                with ui.tooltip().classes('about'):
                    ui.label(_about(control))
            with ui.element('div').classes('line'):
                self._main: Any = self._made()
                if control.kind in ('slider', 'text'):
                    self._field: Any = ui.input(value=written(self._value)).props(
                        f'dense aria-label="{control.name}"').classes('field')
                    self._field.on('keydown.enter', self._typed)
                    self._field.on('blur', self._typed)
            self._problem = ui.label().classes('problem')
        self._problem.set_visibility(False)

    def show(self, value: Value, base: Value | None, *, at_once: bool) -> bool:
        """value: what it is; base: what it is compared with, None where that is not known. at_once: also while the user
        moves it. False where it is to be shown once more, as the user moves it."""
        self._mark.set_visibility(base is not None and value != base)
        if value == self._value and not at_once:  # what is being typed stays
            return True
        if not at_once and time.monotonic() - self._moved < _FRESH:
            return False
        self._display(value)
        return True

    def complain(self, reason: str) -> None:
        """Why a value was refused; empty: it was not."""
        self._problem.set_text(reason)
        self._problem.set_visibility(bool(reason))

    def _made(self) -> Any:
        kind, info = self.control.kind, self.control.info
        if kind == 'slider':
            last = len(self.control.positions) - 1
            return ui.slider(min=0, max=last, step=1, value=self.control.position(info.default),
                             on_change=self._slid).props(f'aria-label="{info.name}"')
        if kind == 'switch':
            return ui.switch(value=bool(info.default), on_change=self._chosen).props(f'dense aria-label="{info.name}"')
        if kind == 'choice':
            return ui.select(list(info.choices), value=info.default, on_change=self._chosen).props(
                f'dense options-dense aria-label="{info.name}"')
        return None

    # No coroutines: those would begin when `_display` is through, and take what it shows for a move of the user's.

    def _slid(self, event: Any) -> Awaitable[None] | None:
        if self._showing or event.value is None:
            return None
        self._moved = time.monotonic()
        self._value = self.control.positions[int(event.value)]
        self._field.set_value(written(self._value))
        return self._move(self.control, self._value)

    def _chosen(self, event: Any) -> Awaitable[None] | None:
        if self._showing or event.value is None:
            return None
        self._value = event.value
        return self._move(self.control, event.value)

    async def _typed(self, _event: Any) -> None:
        """What cannot be a value at all is refused here, all else by the source."""
        text = str(self._field.value or '').strip()
        if text == written(self._value):
            return
        info = self.control.info
        try:
            value: Value = text if info.type is str else info.type(text) if info.type is float else int(text)
        except ValueError:
            try:
                value = info.parse(text)
            except ValueError as error:
                self.complain(str(error))
                self.show(self._value, None, at_once=True)
                return
        await self._move(self.control, value)

    def _display(self, value: Value) -> None:
        """In the slider and in the field, without a move."""
        self._value = value
        self._showing = True
        try:
            if self.control.kind == 'slider':
                self._main.set_value(self.control.position(value))
            elif self.control.kind in ('choice', 'switch'):
                self._main.set_value(value)
            if self.control.kind in ('slider', 'text'):
                self._field.set_value(written(value))
        finally:
            self._showing = False


def _about(control: Control) -> str:
    info = control.info
    unit = f' {info.unit}' if info.unit else ''
    return f'{info.meaning}. {info.allowed}{unit}; default {written(info.default) or "empty"}'
