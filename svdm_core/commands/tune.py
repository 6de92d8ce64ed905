"""`svdm tune`: find parameters, on images with ground truth or without, one at a time or by a search."""
from __future__ import annotations

import argparse
import importlib.util
import json
from pathlib import Path
from typing import TYPE_CHECKING

from ..evaluation.aligned_scenes import alignment_line
from ..evaluation.scene_sets import RESOLUTIONS
from ..files.output_files import check_outputs, write_outputs
from ..missing_modules import not_installed
from ..presets import preset_text
from ..tuning.judges import TruthJudge
from .argument_types import count
from .options import add_align_rows_option, add_parameter_options, add_threads_option
from .tune_studies import UNSUPERVISED, made_proof, made_study

if TYPE_CHECKING:
    from ..tuning import report  # needs rich

_EPILOG = '''Without --search the parameters of --vary are varied one after the other, each from the best so far. A
parameter may be given twice, coarse and then fine. --study paper starts from preset paper_start. --search without
--vary tries the steps next to what is there, of one parameter after the other, and so does --objective unsupervised,
which needs no ground truth: it takes a recording, a folder with folders left and right, or a folder of scenes.'''
_PROOF_SETS = 60


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the arguments."""
    parser.epilog = _EPILOG
    parser.add_argument('folder', type=Path, metavar='FOLDER | BAG',
                        help='scenes in the layout of Middlebury v3 or KITTI; with --objective unsupervised any pairs')
    what = parser.add_mutually_exclusive_group()
    what.add_argument('--vary', action='append', metavar='NAME=VALUES', help='alpha=10:11:0.1 or w_p=11,21,31')
    what.add_argument('--study', choices=('paper',), help="the ranges of the paper's Tables 2 to 5, its figures beside")
    what.add_argument('--importance', action='store_true', help='which parameters matter: each over its steps')
    what.add_argument('--prove', type=count, nargs='?', const=_PROOF_SETS, metavar='N',
                      help='how well the unsupervised loss ranks N sets that ground truth ranks, too (%(const)s)')
    parser.add_argument('--search', type=count, metavar='N',
                        help='search, N trials; with --vary jointly (needs optuna)')
    figures = list(TruthJudge.headings)
    parser.add_argument('--objective', choices=(*figures, UNSUPERVISED), default=figures[0],
                        help='what to make small (%(default)s)')
    add_parameter_options(parser)
    parser.set_defaults(preset=None)
    parser.add_argument('--scenes', nargs='+', action='extend', default=[], metavar='NAME', help='these only')
    _add_pair_arguments(parser)
    add_align_rows_option(parser)
    parser.add_argument('--resolution', choices=RESOLUTIONS,
                        help='of the images: quarter, half or full (Q; KITTI has F only)')
    add_threads_option(parser)
    parser.add_argument('--storage', type=Path, metavar='FILE',
                        help='keep what is computed here; a run that is started again goes on from it')
    parser.add_argument('--json', type=Path, metavar='FILE', help='write all figures')
    parser.add_argument('--html', type=Path, metavar='FILE', help='write a page with plots and maps')
    parser.add_argument('--best', type=Path, metavar='FILE.yaml', help='write the best parameters as a preset')
    parser.add_argument('--force', action='store_true', help='overwrite the files written')


def _add_pair_arguments(parser: argparse.ArgumentParser) -> None:
    pairs = parser.add_argument_group('pairs without ground truth')
    pairs.add_argument('--pairs', type=count, metavar='N', help='chosen, as different as they come (8)')
    pairs.add_argument('--left', metavar='TOPIC', help='left images of a recording with several pairs')
    pairs.add_argument('--right', metavar='TOPIC', help='right images')
    pairs.add_argument('--calib', type=Path, action='append', metavar='FILE',
                       help='calibration of a recording, as process_bag takes it')


def run(options: argparse.Namespace) -> int:
    """Tune, print a table, write what was asked for; 0. ValueError, OSError or ImportError with one line."""
    _check_wanted(options)
    _check_files(options)
    _check_modules(options)
    texts = _proved(options) if options.prove else _tuned(options)
    write_outputs({path: text.encode() for path, text in texts.items()}, options.force)
    return 0


def _proved(options: argparse.Namespace) -> dict[Path, str]:
    """What is to be written."""
    from ..tuning import proof_report

    proof = made_proof(options, options.prove)
    found = proof_report.document(proof)
    proof_report.print_proof(found)
    texts = {options.json: json.dumps(found, indent=1) + '\n'} if options.json else {}
    if options.html:
        texts[options.html] = proof_report.proof_page(proof, found)
    return texts


def _tuned(options: argparse.Namespace) -> dict[Path, str]:
    """What is to be written."""
    study = made_study(options)
    from ..tuning import report

    report.print_table(study)
    print(f'{study.evaluate.maps} maps were computed')
    if study.row_alignment:
        print(alignment_line(study.row_alignment))
    for note in study.notes:
        print(note)
    texts = {}
    if options.json:
        texts[options.json] = json.dumps(report.document(study), indent=1) + '\n'
    if options.html:
        from ..tuning import page
        texts[options.html] = page.page(study)
    if options.best:
        texts[options.best] = preset_text(study.best.parameters, _when_to_take(study))
    return texts


def _check_wanted(options: argparse.Namespace) -> None:
    """Refuse what does not go together."""
    unsupervised = options.objective == UNSUPERVISED
    if not (options.vary or options.study or options.importance or options.prove or options.search or unsupervised):
        raise ValueError('what is to be tuned? Give --vary, --study, --search, --importance, --prove or --objective '
                         'unsupervised')
    truth = next(iter(TruthJudge.headings))
    if options.prove and (options.search or options.objective != truth or options.best or options.changes
                          or options.align_rows or options.preset or options.params):
        raise ValueError('--prove takes scenes and makes its own sets: give it without --search, --objective, --best, '
                         '--preset, --params, --set and --align-rows')
    if options.importance and (options.search or options.best):
        raise ValueError('--importance chooses nothing: give it without --search and --best')
    if options.study and (options.search or unsupervised):
        raise ValueError('--study paper has its own ranges and its own objective: give it without --search and '
                         '--objective unsupervised')
    if unsupervised and (options.scenes or options.resolution):
        raise ValueError('--scenes and --resolution are for ground truth: --objective unsupervised takes the pairs '
                         'that the place holds')
    if not unsupervised and (options.left or options.right or options.calib or options.pairs):
        raise ValueError('--left, --right, --calib and --pairs are for pairs without ground truth: give --objective '
                         'unsupervised, too')


def _check_files(options: argparse.Namespace) -> None:
    """Refuse what could not be written at the end."""
    outputs = [path for path in (options.json, options.html, options.best) if path]
    check_outputs(outputs, options.force)
    if options.best and options.best.suffix not in ('.yaml', '.yml'):
        raise ValueError(f'{options.best}: a preset is read from a .yaml file only: name it so')
    if options.storage:
        check_outputs([options.storage], force=True)
        if options.storage.absolute() in [path.absolute() for path in outputs]:
            raise ValueError(f'{options.storage} is the storage: write something else to another file')


def _check_modules(options: argparse.Namespace) -> None:
    joint = options.search is not None and options.vary
    drawn = options.html or options.prove
    needed = ['rich', *(['optuna'] if joint else []), *(['jinja2', 'matplotlib'] if drawn else [])]
    missing = [name for name in needed if importlib.util.find_spec(name) is None]
    if missing:
        raise ImportError(not_installed(missing))


def _when_to_take(study: report.Study) -> str:
    names = [scene.name for scene in study.evaluate.scenes]
    scenes = ', '.join(names) if len(names) <= 3 else f'{len(names)} scenes, {names[0]} to {names[-1]}'
    error = f'{study.objective} {study.best.average[study.objective]:.2f}'
    return f'Take this one for images like those it was tuned on: {scenes}; {error} there.'
