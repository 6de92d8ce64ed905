"""What all open pages share: the source, the way back, the set that is compared with, the files."""
from __future__ import annotations

import threading
import time
from collections.abc import Mapping
from pathlib import Path

from ..node.parameter_set import NodeParameters, Value, node_parameter_table
from .comparison import Comparison
from .controls import controls
from .parameter_files import ParameterFiles
from .source import Source

_ONE_MOVE = 1.0
"""s; moves of one parameter that follow each other as fast are taken back together."""
_MOST_UNDONE = 200
_UNKNOWN = 'the parameters are not known yet: the node is not there, or has not told them'


class TuningSession:
    """Changes go through here, one at a time; each may take as long as the source takes. For any thread.

    `version` grows with all that a page has to show anew besides pictures and figures.
    """

    def __init__(self, source: Source, folder: Path, preset: str = 'default') -> None:
        """folder: of the parameter files. preset: what the source begins with, a preset or a file."""
        self.source = source
        self.files = ParameterFiles(folder)
        self.comparison: Comparison | None = None
        self.version = 0
        self.preset = preset
        self._base: Mapping[str, Value] = {}
        self._undone: list[dict[str, Value]] = []
        self._moved: tuple[str, float] = ('', 0.0)
        self._lock = threading.Lock()

    @property
    def base(self) -> Mapping[str, Value]:
        """What the page marks differences from: the preset or file that was loaded last, or what the source began
        with."""
        if not self._base:
            self._base = dict(self.source.values())
        return self._base

    @property
    def can_undo(self) -> bool:
        return bool(self._undone)

    def parameters(self) -> NodeParameters:
        """As they are now."""
        return NodeParameters().replace(self.source.values())

    def move(self, name: str, value: Value) -> str:
        """One parameter; the reason where that is refused, else empty."""
        with self._lock:
            before = dict(self.source.values())
            reason = self.source.change({name: value})
            if not reason and before.get(name) != value:
                now = time.monotonic()
                goes_on = self._moved[0] == name and now - self._moved[1] < _ONE_MOVE
                if not goes_on and name in before:
                    self._remember({name: before[name]})
                self._moved = name, now
            self.version += 1
            return reason

    def undo(self) -> str:
        """Take the last change back; as `move`."""
        with self._lock:
            if not self._undone:
                return 'there is nothing to take back'
            reason = self.source.change(self._undone[-1])
            if not reason:
                self._undone.pop()
                self._moved = '', 0.0
            self.version += 1
            return reason

    def reset(self) -> str:
        """Back to the preset or file that was loaded last; as `move`."""
        with self._lock:
            return self._set(self.base)

    def load(self, name: str) -> str:
        """A preset or a file; as `move`."""
        with self._lock:
            try:
                values = self.files.read(name)
            except (ValueError, OSError) as error:
                return str(error)
            reason = self._set(values)
            if not reason:
                self.preset, self._base = name, values
            return reason

    def save(self, name: str, *, replace: bool) -> Path:
        """The file that was written. Raises ValueError or OSError in one line."""
        with self._lock:
            values = self.source.values()
            if not values:
                raise ValueError(_UNKNOWN)
            return self.files.write(name, values, replace=replace)

    def hold(self) -> str:
        """Keep the set that is there now, and a pair to compare others with it on; as `move`."""
        frame = self.source.hold()
        with self._lock:
            if not self.source.values():
                return _UNKNOWN
            if frame is None:
                return 'no pair has come to compare on'
            self.comparison = Comparison(frame, self.parameters())
            self.version += 1
            return ''

    def release(self) -> str:
        """Compare no more; empty."""
        with self._lock:
            self.comparison = None
            self.version += 1
            return ''

    def take_held(self) -> str:
        """Go back to the set that is held; as `move`."""
        with self._lock:
            if self.comparison is None:
                return 'nothing is held'
            return self._set({info.name: self.comparison.held.value(info.name) for info in node_parameter_table()})

    def _set(self, wanted: Mapping[str, Value]) -> str:
        """What is on the page, where it differs: where images come from is not the page's to change."""
        now = self.source.values()
        if not now:
            return _UNKNOWN
        names = [control.name for control in controls() if control.name in now]
        changes = {name: wanted[name] for name in names if wanted[name] != now[name]}
        reason = self.source.change(changes) if changes else ''
        if not reason and changes:
            self._remember({name: now[name] for name in changes})
        self._moved = '', 0.0
        self.version += 1
        return reason

    def _remember(self, values: dict[str, Value]) -> None:
        self._undone.append(values)
        del self._undone[:-_MOST_UNDONE]
