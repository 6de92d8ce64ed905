"""`svdm match`: the disparity of one pair as a file, and a picture of it."""
from __future__ import annotations

import argparse
from pathlib import Path

import cv2
import numpy as np

from ..files.colour_maps import DISPARITY_COLOURS, colour_map, shown_range
from ..files.disparity_files import check_suffix, encode_disparity, encode_png
from ..files.images import read_image
from ..files.output_files import check_outputs, write_outputs
from ..kernels.arrays import Image
from ..matcher import StereoMatcher
from ..parameters import MatcherParameters
from ..row_alignment.alignment import NOTHING_TO_CORRECT, RowAlignment
from ..row_alignment.estimation import estimate_row_alignment
from .argument_types import FROM_THE_PAIRS, alignment_file
from .options import add_parameter_options, add_threads_option, parameters_of

_AS_IT_IS = cv2.IMREAD_ANYDEPTH | cv2.IMREAD_ANYCOLOR


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """The pair, the parameters, and what is written."""
    parser.add_argument('left', type=Path, metavar='LEFT', help='left image, rectified, 8 or 16 bit, grey or colour')
    parser.add_argument('right', type=Path, metavar='RIGHT', help='right image, of the same size and kind')
    add_parameter_options(parser)
    add_threads_option(parser)
    parser.add_argument('--align-rows', nargs='?', type=alignment_file, const=FROM_THE_PAIRS, metavar='FILE',
                        help='align the rows of the right image first, by a .yaml of svdm check-rectification; without '
                             'FILE, by what this pair shows')
    parser.add_argument('-o', '--output', type=Path, default=Path('disparity.pfm'), metavar='OUT',
                        help='.pfm, .npy, or .png of 16 bit: disparity x 256, 0 is unknown (disparity.pfm)')
    parser.add_argument('--preview', type=Path, metavar='PNG', help='picture in colour (OUT_preview.png)')
    parser.add_argument('--valid-only', action='store_true',
                        help='leave unknown what fails the left-right check (filled without this)')
    parser.add_argument('--force', action='store_true', help='overwrite files that exist')


def run(options: argparse.Namespace) -> int:
    """Match, write, and say what was written; 0."""
    output = options.output
    check_suffix(output)
    preview = options.preview or output.with_name(f'{output.stem}_preview.png')
    if preview.suffix.lower() != '.png':
        raise ValueError(f'{preview}: the suffix {preview.suffix!r} is not allowed: a preview is a .png')
    check_outputs((output, preview), options.force)
    parameters = parameters_of(options)
    matcher = StereoMatcher(parameters, options.threads)
    left, right = (read_image(path, _AS_IT_IS) for path in (options.left, options.right))
    rows = _row_alignment(options.align_rows, left, right, parameters)
    result = matcher.compute(left, right, rows)
    disparity = result.disparity
    if options.valid_only:
        disparity = np.where(result.valid, disparity, np.float32(np.inf))
    low, high = shown_range(disparity)
    picture = colour_map(disparity, low, high, DISPARITY_COLOURS, unknown=(0, 0, 0))
    write_outputs({output: encode_disparity(disparity, output), preview: encode_png(picture)}, options.force)
    if options.align_rows is not None:
        print(_alignment_line(options.align_rows, rows))
    print(f'{output}: {disparity.shape[1]} x {disparity.shape[0]} px, {100 * result.valid.mean():.1f} % are valid')
    print(f'{preview}: {low:g} px blue to {high:g} px red')
    return 0


def _row_alignment(
    source: Path | None, left: Image, right: Image, parameters: MatcherParameters
) -> RowAlignment | None:
    """From a file, or of this pair; None where there is none."""
    if source is None or (source == FROM_THE_PAIRS and left.shape != right.shape):  # which the matcher refuses
        return None
    if source != FROM_THE_PAIRS:
        return RowAlignment.load(source)
    return estimate_row_alignment((left, right), parameters.min_disparity, parameters.num_disparities)


def _alignment_line(source: Path, rows: RowAlignment | None) -> str:
    if rows is None:
        return f'rows: {NOTHING_TO_CORRECT} (svdm check-rectification says which)'
    by = '' if source == FROM_THE_PAIRS else f' by {source}'
    return f'rows aligned{by}: {rows.line()}'
