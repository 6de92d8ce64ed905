"""One recording from end to end: every pair in, every disparity out."""
from __future__ import annotations

import contextlib
import dataclasses
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from svdm_core import RowAlignment
from svdm_core.memory import lacking_text
from svdm_core.shown import cut

from ...calibration.stereo_calibration import StereoCalibration
from ...command_line.interrupts import deferred_interrupts
from ...frames.frame_preparation import PreparedFrame
from ...frames.frame_processing import FrameProcessor
from ...frames.views import FrameError, StereoFrame
from ...node.parameter_set import NodeParameters
from ..reading.pair_stream import PairStream, RecordedPair
from ..reading.recording import RecordedMessage, Recording, RecordingError, open_recording
from ..reading.sqlite_file import log_of
from ..reading.stereo_topics import StereoTopics, find_side_by_side, find_stereo_topics, ground_truth_lines
from ..writing.output_place import SUMMARY_FILE, PlaceTakenError, check_apart, check_place
from ..writing.partial_bag import PartialBag, open_partial
from ..writing.partial_folder import partial_path, remove_marks
from ..writing.stereo_messages import infos_of
from .outputs import Outputs
from .preview import write_preview
from .row_estimate import estimate_rows, stereo_frame, unrectified_lines
from .summary import Progress, Summary
from .threads import WriteBehind, read_ahead

_FORMAT = 2
"""Raised with every change of the messages that are written for the same recording and the same options."""
_AHEAD = 8
"""Messages that are read ahead, and results that wait to be written."""
_NOTES_TOLD = 3
"""In the line on a recording without a pair, of what is left out of it."""

Tell = Callable[[int, int], None]
"""Told of the pairs dealt with and, as far as it is known beforehand, of how many there are."""


@dataclasses.dataclass(frozen=True, slots=True)
class Job:
    """One recording to process, and how. Picklable.

    start_s, duration_s: from the beginning of the recording; None is to its end. calibration: in place of the recorded
    camera_info. preview: 'mp4' or 'png', see `preview`. rows: align the rows by this, or by what the recording shows
    where `estimate_rows` is set; the parameter align_rows is the live node's.
    """

    input: Path
    output: Path
    parameters: NodeParameters = dataclasses.field(default_factory=NodeParameters)
    left: str | None = None
    right: str | None = None
    start_s: float = 0.0
    duration_s: float | None = None
    copy_inputs: bool = False
    outputs: tuple[str, ...] = ('disparity',)
    calibration: StereoCalibration | None = None
    preview: str | None = None
    force: bool = False
    rows: RowAlignment | None = None
    estimate_rows: bool = False


class NoPairsError(ValueError):
    """A recording in which no two images make a pair."""


def check_output(output: Path, force: bool) -> None:
    """Raise ValueError where `output` cannot become a bag, or is there already."""
    if output.suffix in ('.mcap', '.db3', '.bag'):
        raise ValueError(f'{output}: a bag is a folder: name it without {output.suffix}')
    remove_marks(output)
    check_place(output, force)


def process(job: Job, tell: Tell = lambda done, total: None) -> Summary:
    """Process one recording; the output has its name when this returns a Summary without a problem.

    Where the recording turns out damaged, or the disk is full, what is done stays in the partial bag and `problem` of
    the Summary says why. Raises ValueError (RecordingError, NoPairsError included) where there is nothing to do or it
    cannot be begun. KeyboardInterrupt leaves the partial bag readable.
    """
    check_apart(job.output, [job.input])
    check_output(job.output, job.force)
    with open_recording(job.input) as recording:
        topics = _topics(job, recording)
        images = frozenset({topics.left, topics.right}) if job.copy_inputs else frozenset()
        infos = infos_of(job.calibration) if job.calibration else None
        outputs = Outputs(topics, images | frozenset(topics.infos), job.outputs, calibrated=infos is not None)
        start_ns = recording.start_ns + round(job.start_s * 1e9)
        if start_ns > recording.end_ns:
            lasts = (recording.end_ns - recording.start_ns) / 1e9
            raise RecordingError(f'{job.input}: it lasts {lasts:g} s, nothing is left from --start {job.start_s:g} on')
        stop_ns = recording.end_ns if job.duration_s is None else start_ns + round(job.duration_s * 1e9)
        stream = PairStream(recording, topics, job.parameters.tolerance_ns, copied=outputs.copied,
                            start_ns=start_ns, stop_ns=stop_ns, infos=infos)
        declared = outputs.declared(recording)
        with open_partial(job.output, declared, _settings(job, topics), force=job.force) as bag:
            run = _Run(job, topics, stream, outputs, bag)
            return run(lambda done: tell(done, _expected(recording, topics, start_ns, stop_ns)))


class _Run:
    """The pass over one recording; the state is that of the partial bag."""

    def __init__(
        self, job: Job, topics: StereoTopics, stream: PairStream, outputs: Outputs, bag: PartialBag
    ) -> None:
        self._job = job
        self._topics = topics
        self._stream = stream
        self._outputs = outputs
        self._bag = bag
        self._processor = FrameProcessor(rows=self._rows_of)
        try:
            self._progress = Progress.of(bag.state)
        except ValueError as error:
            raise bag.damaged(str(error)) from None
        if job.rows is not None:
            self._progress.rows = job.rows.as_dict()
        self._rows = self._progress.row_alignment
        self._row_note = ''
        self._written = bag.state
        self._matched = 0
        self._matcher_ms = 0.0

    def __call__(self, tell: Callable[[int], None]) -> Summary:
        start = time.perf_counter()
        problem = ''
        try:
            self._processor.warm_up(self._job.parameters)
            if self._job.estimate_rows and self._rows is None:  # else by what a run before has found
                self._estimate_rows()
            start = time.perf_counter()
            self._pass(tell)
            if self._progress.disparities:
                self._bag.finish(lambda folder: self._add_files(folder, start))
        except (RecordingError, PlaceTakenError) as error:
            problem = str(error)
        except OSError as error:
            problem = (f'{partial_path(self._job.output)}: cannot be written: {error.strerror}; make room, then the '
                       'same command goes on from there')
        except MemoryError as error:
            problem = f'{self._job.input}: out of memory: {lacking_text(error)}'
        summary = dataclasses.replace(self._summary(start), problem=problem)
        if problem:  # what counts is what reached the disk
            self._progress = Progress.of(self._bag.state)
            summary = dataclasses.replace(summary, progress=self._progress)
        if not self._progress.disparities:
            self._bag.discard()
            raise NoPairsError(problem or _nothing(self._job, summary, self._stream.recording))
        return summary

    def _add_files(self, folder: Path, start: float) -> None:
        (folder / SUMMARY_FILE).write_bytes(self._summary(start).json())
        if self._job.preview:
            write_preview(folder, self._job.preview)

    def _pass(self, tell: Callable[[int], None]) -> None:
        writer: WriteBehind[Callable[[], None]] = WriteBehind(lambda write: write(), _AHEAD)
        to_skip = self._progress.done
        with deferred_interrupts() as raise_if_interrupted:
            try:
                with contextlib.closing(read_ahead(self._stream, _AHEAD)) as entries:
                    for number, entry in enumerate(entries):
                        if number >= to_skip:
                            self._process(entry, writer)
                        tell(self._progress.disparities + self._progress.dropped.total())
                        raise_if_interrupted()
            finally:
                # Whatever ended the pass, a signal or a damaged recording: what is done is kept.
                writer.close()
                self._bag.commit(self._written, now=True)

    def _process(self, entry: RecordedPair | RecordedMessage, writer: WriteBehind[Callable[[], None]]) -> None:
        if isinstance(entry, RecordedMessage):
            messages: Iterator[tuple[str, bytes | memoryview]] = iter([(entry.topic, entry.data)])
        else:
            messages = self._matched_messages(entry)
        self._progress.done += 1
        state = self._progress.as_dict()
        writer.put(lambda: self._write(messages, entry.time_ns, state))

    def _estimate_rows(self) -> None:
        estimate = estimate_rows(self._stream, self._frame, self._job.parameters)
        self._rows = estimate.rows
        self._progress.rows = estimate.rows.as_dict() if estimate.rows else {}
        self._row_note = estimate.note

    def _rows_of(self, frame: PreparedFrame) -> RowAlignment | None:
        """By what the rows of a pair are aligned: a file that was given is for all, an estimate for those of its size.
        """
        rows = self._rows
        if rows is None or rows.is_identity or (
                self._job.rows is None and frame.pair.left.shape[:2] != (rows.height, rows.width)):
            return None
        return rows

    def _frame(self, pair: RecordedPair) -> StereoFrame:
        return stereo_frame(pair, self._job.parameters.input == 'raw' or self._is_calibrated_raw(pair))

    def _matched_messages(self, pair: RecordedPair) -> Iterator[tuple[str, bytes | memoryview]]:
        progress, frame = self._progress, self._frame(pair)
        try:
            result = self._processor.process(frame, self._job.parameters)
        except FrameError as error:
            progress.drop(error.reason, str(error))
            return iter(())
        progress.disparities += 1
        self._matched += 1
        self._matcher_ms += result.timings['total']
        if frame.raw and self._job.parameters.input != 'raw':
            progress.notes['the images were rectified by the calibration given'] += 1
        if not frame.raw:
            progress.notes.update(unrectified_lines(pair, self._topics))
        progress.notes.update(filter(None, (result.problem, result.hint)))
        if pair.ground_truth is not None:
            progress.judge(result.frame.published, pair.ground_truth)
        return self._outputs.messages(pair, result.frame)

    def _is_calibrated_raw(self, pair: RecordedPair) -> bool:
        """Whether the calibration that was given is that of raw cameras, and the topics do not say `rect`."""
        return self._job.calibration is not None and any(unrectified_lines(pair, self._topics))

    def _write(
        self, messages: Iterator[tuple[str, bytes | memoryview]], time_ns: int, state: dict[str, Any]
    ) -> None:
        for topic, data in messages:
            self._bag.write(topic, time_ns, data)
        self._written = state
        self._bag.commit(state)

    def _summary(self, start: float) -> Summary:
        return Summary(
            str(self._job.input), str(self._job.output), self._topics.left, self._topics.right,
            _as_dict(self._job.parameters), self._stream.counts, self._progress, self._matched,
            time.perf_counter() - start, self._matcher_ms / max(self._matched, 1),
            notes=(*self._stream.recording.notes, *ground_truth_lines(self._stream.recording.topics),
                   *filter(None, [self._row_note])),
            missing=self._stream.recording.missing)


def _topics(job: Job, recording: Recording) -> StereoTopics:
    raw = job.parameters.input == 'raw'
    try:
        if job.parameters.layout == 'side_by_side':
            if job.right not in (None, job.left):
                raise RecordingError(f'--right {job.right} is not allowed with layout = side_by_side: name the one '
                                     'topic that holds both views with --left')
            topics = find_side_by_side(recording.topics, job.left, raw)
        else:
            topics = find_stereo_topics(recording.topics, job.left, job.right, raw)
    except RecordingError as error:
        notes = [cut(note.removeprefix(f'{job.input}: ')) for note in (*recording.missing, *recording.notes)]
        raise RecordingError('; '.join([f'{job.input}: {error}', *notes[:_NOTES_TOLD]])) from None
    return dataclasses.replace(topics, left_info=None, right_info=None) if job.calibration else topics


def _expected(recording: Recording, topics: StereoTopics, start_ns: int, stop_ns: int) -> int:
    """About how many pairs there are; exact where the whole recording is taken and no image is alone."""
    most = min(recording.topics[topics.left].count, recording.topics[topics.right].count)
    taken = (min(stop_ns, recording.end_ns) - start_ns) / max(recording.end_ns - recording.start_ns, 1)
    return round(most * min(max(taken, 0), 1))


def _settings(job: Job, topics: StereoTopics) -> dict[str, Any]:
    """What the output depends on: only a run with the same may go on with a partial bag."""
    files = [job.input] if job.input.is_file() else sorted(path for path in job.input.iterdir() if path.is_file())
    logs = {log_of(path) for path in files} - {path.resolve() for path in files}
    files += sorted(log for log in logs if log.exists())
    # The number of threads changes no message.
    parameters = {name: value for name, value in _as_dict(job.parameters).items() if name != 'num_threads'}
    return {
        'version of the output format': _FORMAT,
        'recording': [[path.name, path.stat().st_size, path.stat().st_mtime_ns] for path in files],
        'topics': [topics.left, topics.right],
        'parameters': parameters,
        '--start': job.start_s, '--duration': job.duration_s, '--copy-inputs': job.copy_inputs,
        '--outputs': list(job.outputs), '--calib': _matrices(job.calibration),
        **({'--align-rows': 'estimated' if job.rows is None else job.rows.as_dict()}
           if job.rows is not None or job.estimate_rows else {}),
        **({'begun, as the past of temporal_filter is not kept': time.time_ns()}
           if job.parameters.temporal_filter > 0 else {}),
    }


def _matrices(calibration: StereoCalibration | None) -> list[list[float]] | None:
    if calibration is None:
        return None
    return [[*(camera.size or ()), *(float(value) for matrix in (camera.k, camera.d, camera.r, camera.p)
                                     for value in matrix.ravel())] for camera in (calibration.left, calibration.right)]


def _as_dict(parameters: NodeParameters) -> dict[str, Any]:
    own = dataclasses.asdict(parameters)
    del own['align_rows']  # is the live node's
    return {**own.pop('matcher'), **own}


def _nothing(job: Job, summary: Summary, recording: Recording) -> str:
    counts = summary.pairing
    if summary.progress.dropped:
        reason, count = summary.progress.dropped.most_common(1)[0]
        return f'{job.input}: none of {counts.pairs} pairs could be matched ({count} {reason}): ' + (
            summary.progress.reasons[reason])
    gap = '' if counts.closest_gap_ns is None else (
        f', the closest stamps are {counts.closest_gap_ns / 1e9:g} s apart: '
        'give that, or a little more, as --set approximate_sync_tolerance=SECONDS')
    lie = '' if any(counts.images.values()) else recording.where([summary.left, summary.right])
    return (f'{job.input}: no pair among {counts.images["left"]} images on {summary.left} and '
            f'{counts.images["right"]} on {summary.right}{gap}{lie}')
