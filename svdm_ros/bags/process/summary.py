"""What came of one recording: counts, rate, error against ground truth; as text and as JSON."""
from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Iterator
from typing import Any

import numpy as np
from numpy.typing import NDArray

from svdm_core import RowAlignment
from svdm_core.row_alignment.alignment import NOTHING_TO_CORRECT
from svdm_core.shown import shown

from ...frames.image_conversion import pixels_of
from ..reading.pair_stream import PairingCounts

BAD_PX = 3.0


@dataclasses.dataclass(slots=True)
class Progress:
    """What is counted pair by pair; kept with the partial bag, so that a run that goes on has it all.

    done: entries of the stream that are dealt with. dropped: pairs that could not be matched, by reason; `reasons`
    has the line of the first of each. notes: why results may be wrong, and in how many pairs. rows: what RowAlignment
    has as a dict, that of the pairs; {} where rows are not aligned, coefficients of 0 where they need not be.
    """

    done: int = 0
    disparities: int = 0
    dropped: Counter[str] = dataclasses.field(default_factory=Counter)
    reasons: dict[str, str] = dataclasses.field(default_factory=dict)
    notes: Counter[str] = dataclasses.field(default_factory=Counter)
    error_sum: float = 0.0
    bad_pixels: int = 0
    judged_pixels: int = 0
    rows: dict[str, Any] = dataclasses.field(default_factory=dict)

    @classmethod
    def of(cls, state: dict[str, Any]) -> Progress:
        """From `as_dict`, {} included. Raises ValueError where it is of another shape."""
        progress = cls()
        for name, value in state.items():
            kept = getattr(progress, name, None)
            if name not in progress.as_dict() or not (isinstance(value, dict) if name == 'rows' else
                                                      _is_alike(kept, value)):
                raise ValueError(f'{shown(name)} is {shown(value)}, which no run counts')
            setattr(progress, name, type(getattr(progress, name))(value))
        _ = progress.row_alignment
        return progress

    @property
    def row_alignment(self) -> RowAlignment | None:
        """Of `rows`. Raises ValueError where they are none."""
        try:
            return RowAlignment(**self.rows) if self.rows else None
        except TypeError as error:
            raise ValueError(f'rows: {error}') from None

    def as_dict(self) -> dict[str, Any]:
        """For JSON."""
        return {field.name: _plain(getattr(self, field.name)) for field in dataclasses.fields(self)}

    def drop(self, reason: str, line: str) -> None:
        """One more pair without a disparity."""
        self.dropped[reason] += 1
        self.reasons.setdefault(reason, line)

    def judge(self, found: NDArray[np.float32], ground_truth: Any) -> None:
        """Add the error of published disparities, float32 (H, W), against a DisparityImage, where that is valid."""
        try:
            truth = pixels_of(ground_truth.image)
        except ValueError as reason:
            self.notes[f'the ground truth is no disparity: {reason}'] += 1
            return
        if truth.shape != found.shape:
            self.notes['the ground truth has another size than the images'] += 1
            return
        known = np.isfinite(truth) & (truth >= ground_truth.min_disparity) & (truth > 0)
        error = np.abs(found[known] - truth[known])
        self.error_sum += float(error.sum(dtype=np.float64))
        self.bad_pixels += int((error > BAD_PX).sum())
        self.judged_pixels += int(known.sum())


def _is_alike(kept: Any, value: Any) -> bool:
    """Whether `value` comes from a field that is now `kept`, by way of JSON."""
    if isinstance(kept, Counter):
        return isinstance(value, dict) and all(isinstance(count, int) and count >= 0 for count in value.values())
    if isinstance(kept, dict):
        return isinstance(value, dict) and all(isinstance(line, str) for line in value.values())
    return isinstance(value, (int, type(kept))) and not isinstance(value, bool) and value >= 0


def _plain(value: Any) -> Any:
    return dict(value) if isinstance(value, dict) else value


@dataclasses.dataclass(frozen=True, slots=True)
class Summary:
    """One recording. `seconds` and `matched` are of this run alone, `matcher_ms` the matcher's own mean a pair.

    problem: why the end was not reached; empty for a complete output. notes, missing: as Recording has them.
    """

    input: str
    output: str
    left: str
    right: str
    parameters: dict[str, Any]
    pairing: PairingCounts
    progress: Progress
    matched: int
    seconds: float
    matcher_ms: float
    problem: str = ''
    notes: tuple[str, ...] = ()
    missing: tuple[str, ...] = ()

    @property
    def pairs_per_second(self) -> float:
        """Of this run, from the first message read to the last one written."""
        return self.matched / self.seconds if self.seconds > 0 else 0.0

    @property
    def exit_code(self) -> int:
        """0 where every pair has its disparity, 1 where something is missing."""
        return 1 if self.problem or self.missing or self.progress.dropped else 0

    def document(self) -> dict[str, Any]:
        """For JSON."""
        progress = self.progress
        return {
            'input': self.input, 'output': self.output, 'left': self.left, 'right': self.right,
            'complete': not self.problem, 'problem': self.problem,
            'recording': [*self.missing, *self.notes],
            'images': self.pairing.images, 'pairs': self.pairing.pairs, 'disparities': progress.disparities,
            'unpaired': self.pairing.unpaired, 'unpaired_reason': self._unpaired_reason(),
            'dropped': dict(progress.dropped), 'dropped_reasons': progress.reasons, 'notes': dict(progress.notes),
            'ground_truth': self._error(), 'row_alignment': progress.rows or None,
            'matched_in_this_run': self.matched, 'seconds': round(self.seconds, 3),
            'pairs_per_second': round(self.pairs_per_second, 3), 'matcher_ms': round(self.matcher_ms, 3),
            'parameters': self.parameters,
        }

    def json(self) -> bytes:
        """The document as text."""
        return (json.dumps(self.document(), indent=1, allow_nan=False) + '\n').encode()

    def lines(self) -> Iterator[str]:
        """For the terminal."""
        progress, pairing = self.progress, self.pairing
        place = self.output if not self.problem else f'{self.output}.partial'
        yield f'{place}: {progress.disparities} disparities of {pairing.pairs} pairs'
        yield (f'  {self.matched} matched in {self.seconds:.1f} s, {self.pairs_per_second:.2f} pairs a second; the '
               f'matcher itself took {self.matcher_ms:.1f} ms a pair')
        for line in (*self.missing, *self.notes):
            yield f'  {line}'
        if any(pairing.unpaired.values()):
            yield (f'  unpaired: {pairing.unpaired["left"]} of {pairing.images["left"]} left, '
                   f'{pairing.unpaired["right"]} of {pairing.images["right"]} right images: {self._unpaired_reason()}')
        if (rows := progress.row_alignment) is not None:
            yield f'  rows: {NOTHING_TO_CORRECT}' if rows.is_identity else f'  rows aligned: {rows.line()}'
        for reason, count in sorted(progress.dropped.items()):
            yield f'  {count} without disparity, the first: {progress.reasons[reason]}'
        for note, count in sorted(progress.notes.items()):
            yield f'  in {count} pairs: {note}'
        if (error := self._error()) is not None:
            yield (f'  against ground truth: mean error {error["mean_error_px"]:.2f} px, '
                   f'{error["bad_3px_percent"]:.1f} % off by more than {BAD_PX:g} px')

    def _unpaired_reason(self) -> str:
        if not any(self.pairing.unpaired.values()):
            return ''
        tolerance = self.parameters['approximate_sync_tolerance']
        if not tolerance:
            return 'no partner of the same stamp; --set approximate_sync_tolerance=SECONDS pairs others'
        return f'no partner within approximate_sync_tolerance = {tolerance:g} s'

    def _error(self) -> dict[str, float] | None:
        progress = self.progress
        if not progress.judged_pixels:
            return None
        return {'mean_error_px': progress.error_sum / progress.judged_pixels,
                'bad_3px_percent': 100 * progress.bad_pixels / progress.judged_pixels,
                'pixels': progress.judged_pixels}
