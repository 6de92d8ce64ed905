"""`svdm check-rectification`: how far the rows of pairs are apart, what that means, and the alignment as a file."""
from __future__ import annotations

import argparse
import importlib.util
from collections.abc import Mapping
from pathlib import Path

from ..evaluation.pair_folders import PairSource
from ..evaluation.recordings import pair_sources
from ..files.output_files import check_outputs, write_outputs
from ..missing_modules import not_installed
from ..parameters import parameter_info
from ..row_alignment.alignment import RowAlignment
from ..row_alignment.report import RectificationReport, Verdict, check_rectification
from .argument_types import count
from .options import disparities

_MOST_PAIRS = 50
_WIDTH = 140  # characters, where the output is no terminal


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The pairs, the search range, and what is written."""
    parser.add_argument('places', type=Path, nargs='+', metavar='FOLDER | BAG | LEFT RIGHT',
                        help='a folder with folders left and right (or of KITTI) with the frames of two cameras, a '
                             'folder of scenes with im0.png and im1.png, a recording (of ROS 2 or 1, with svdm_ros), '
                             'or two images')
    parser.add_argument('--left', metavar='TOPIC', help='left images of a recording with several pairs')
    parser.add_argument('--right', metavar='TOPIC', help='right images')
    parser.add_argument('--calib', type=Path, action='append', metavar='FILE',
                        help='calibration of a recording, as process_bag takes it')
    parser.add_argument('--min-disparity', type=_min_disparity, default=0, metavar='N', help='px (0)')
    parser.add_argument('--num-disparities', type=disparities, metavar='N',
                        help='searched, px (what calib.txt says, else a fifth of the width)')
    parser.add_argument('--pairs', type=count, default=_MOST_PAIRS, metavar='N',
                        help='of a camera, at most, evenly over all (%(default)s)')
    parser.add_argument('-o', '--output', type=Path, metavar='FILE.yaml',
                        help='write the alignment, for svdm match --align-rows; one camera only')
    parser.add_argument('--plot', type=Path, metavar='FILE.png', help='write a picture of the offsets and the field')
    parser.add_argument('--force', action='store_true', help='overwrite files that exist')


def run(options: argparse.Namespace) -> int:
    """Check, print a table, write what was asked for; 0. ValueError, OSError or ImportError with one line."""
    _check_files(options)
    cameras = pair_sources(options.places, (options.left, options.right), options.calib)
    if options.output and len(cameras) > 1:
        raise ValueError(f'{options.output}: {len(cameras)} scenes have cameras of their own: give one of them')
    if options.plot and importlib.util.find_spec('matplotlib') is None:
        raise ImportError(not_installed(['matplotlib']))
    reports = {camera.name: _report(camera, options) for camera in cameras}
    for note in (note for camera in cameras for note in camera.notes):
        print(note)
    _print_table(reports)
    contents, told = {}, []
    if options.output:
        [report] = reports.values()
        rows = _alignment(report, options.output)
        contents[options.output] = rows.as_yaml().encode()
        told.append(f'{options.output}: ' + ('corrects nothing' if rows.is_identity else rows.line()))
    if options.plot:
        from ..row_alignment.plot import plot_reports
        contents[options.plot] = plot_reports(reports)
        told.append(f'{options.plot}: offsets and field')
    write_outputs(contents, options.force)
    for text in told:
        print(text)
    return 0


def _min_disparity(text: str) -> int:
    try:
        return int(parameter_info('min_disparity').parse(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def _check_files(options: argparse.Namespace) -> None:
    for path, suffixes in ((options.output, ('.yaml', '.yml')), (options.plot, ('.png',))):
        if path and path.suffix not in suffixes:
            raise ValueError(f'{path}: the suffix {path.suffix!r} is not allowed: it must be {suffixes[0]}')
    check_outputs([path for path in (options.output, options.plot) if path], options.force)


def _report(camera: PairSource, options: argparse.Namespace) -> RectificationReport:
    pairs = list(camera.read(options.pairs))
    number = options.num_disparities or camera.num_disparities or max(16, pairs[0][0].shape[1] // 5)
    try:
        return check_rectification(pairs, options.min_disparity, number)
    except ValueError as error:
        raise ValueError(f'{camera.name}: {error}') from None


def _alignment(report: RectificationReport, path: Path) -> RowAlignment:
    """What is to be written: no correction where the rows are aligned. ValueError where that is not known."""
    if report.verdict in (Verdict.UNKNOWN, Verdict.NOT_RECTIFIED):
        raise ValueError(f'{path} is not written, {report.verdict.value}: {report.advice}')
    return report.alignment or RowAlignment.identity(report.shape[1], report.shape[0])


def _print_table(reports: Mapping[str, RectificationReport]) -> None:
    from rich.console import Console
    from rich.markup import escape
    from rich.table import Table

    from ..shown import cut

    table = Table(title='vertical offsets, px: row in the right image minus row in the left')
    places = list(next(iter(reports.values())).places())
    for heading in ('', *(place.replace(' ', '\n') for place in places), 'points', 'before', 'after', 'verdict'):
        table.add_column(heading, justify='left' if heading in ('', 'verdict') else 'right', no_wrap=True)
    for name, report in reports.items():
        offsets = [f'{offset:+.2f}' if report.alignment else '-' for offset in report.places().values()]
        before, after = (f'{value:.2f}' if report.points.size else '-' for value in report.residuals)
        table.add_row(escape(cut(name)), *offsets, str(report.points.size), before, after, report.verdict.value)
    console = Console()
    console = console if console.is_terminal else Console(width=_WIDTH)
    console.print(table)
    console.print('before, after: median of the absolute offsets, without and with the alignment', soft_wrap=True)
    for verdict in dict.fromkeys(report.verdict for report in reports.values()):
        names = [name for name, report in reports.items() if report.verdict is verdict]
        advice = next(report.advice for report in reports.values() if report.verdict is verdict)
        told = f' ({", ".join(map(cut, names))})' if len(reports) > 1 else ''
        console.print(f'{verdict.value}{told}: {advice}', soft_wrap=True, highlight=False, markup=False)
