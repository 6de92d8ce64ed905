"""A file of figures: what was computed once is not computed again, also not by the next run."""
from __future__ import annotations

import functools
import hashlib
import json
from pathlib import Path
from typing import Any

from ..files.user_files import Limits, check_regular
from ..kernels.cache import fingerprint

_MATCHER = Path(__file__).resolve().parents[1]
_MEASURES = ('evaluation/metrics.py', 'evaluation/streaks.py', 'evaluation/reconstruction.py', 'tuning/judges.py',
             'tuning/consensus.py',
             'row_alignment/measurement.py')
_START = b'{"key": "'
_LIMITS = Limits(2**30)


class FigureStore:
    """Figures of scenes by everything they follow from; kept in memory and, where there is a path, in that file.

    The file has a line of JSON for each scene and set of parameters, appended as soon as it is known. An interrupted
    run leaves at most half a line at its end, which is passed over.
    """

    def __init__(self, path: Path | None = None) -> None:
        """Reads the file where there is one. ValueError where it is no such file, OSError where it cannot be used."""
        self._path = path
        self._known: dict[str, dict[str, float]] = {}
        if path is None:
            return
        if path.exists():
            check_regular(path, _LIMITS)
        lines = path.read_bytes().split(b'\n') if path.exists() else [b'']
        for number, line in enumerate(lines, 1):
            if line and not _is_torn(line):
                self._read(line, number)
        with path.open('ab') as file:  # shows now, not after the first scene, that it can be written
            if lines[-1]:
                file.write(b'\n')

    def get(self, key: str) -> dict[str, float] | None:
        """The figures under `key`, if known."""
        return self._known.get(key)

    def put(self, key: str, figures: dict[str, float], **notes: Any) -> None:
        """Keep figures under `key`; the notes say in the file what they belong to."""
        self._known[key] = figures
        if self._path is not None:
            line = json.dumps({'key': key, **notes, 'figures': figures}, allow_nan=False)
            with self._path.open('ab') as file:
                file.write(line.encode() + b'\n')

    def _read(self, line: bytes, number: int) -> None:
        try:
            entry = json.loads(line)
        except (ValueError, RecursionError):
            entry = None
        if not isinstance(entry, dict) or not {'key', 'figures'} <= set(entry):
            raise ValueError(f'{self._path}: line {number} is not of a file of svdm tune: name another file')
        self._known[entry['key']] = entry['figures']


def _is_torn(line: bytes) -> bool:
    """Whether an interrupted run may have left this, the beginning of a line."""
    return not line.endswith(b'}}') and (line.startswith(_START) or _START.startswith(line))


@functools.cache
def sources_fingerprint() -> str:
    """Of the matcher and of the measures: the kernels, the modules outside of the kernels' folders, and the figures."""
    digest = hashlib.sha256(fingerprint().encode())
    for path in (*sorted(_MATCHER.glob('*.py')), *(_MATCHER / name for name in _MEASURES)):
        digest.update(path.read_bytes())
    return digest.hexdigest()
