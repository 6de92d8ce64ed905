"""What several commands share of their command lines."""
from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from ..parameters import MatcherParameters, parameter_info
from ..presets import load_preset
from ..shown import cut
from .argument_types import count


def disparities(text: str) -> int:
    """A number of disparities, as the parameter num_disparities allows it."""
    try:
        return int(parameter_info('num_disparities').parse(text))
    except ValueError as error:
        raise argparse.ArgumentTypeError(str(error)) from None


def add_parameter_options(parser: argparse.ArgumentParser) -> None:
    """--preset or --params, and --set."""
    source = parser.add_mutually_exclusive_group()
    source.add_argument('--preset', default='default', metavar='P', help='preset by name, or a .yaml file (default)')
    source.add_argument('--params', type=Path, metavar='FILE', help='parameter file, as ros2 takes it')
    parser.add_argument('--set', nargs='+', action='extend', default=[], dest='changes', metavar='NAME=VALUE',
                        help='change parameters of it, checked by the table of parameters')


def add_threads_option(parser: argparse.ArgumentParser) -> None:
    """--threads."""
    parser.add_argument('--threads', type=count, default=0, metavar='N', help='threads (one a processor)')


def add_align_rows_option(parser: argparse.ArgumentParser) -> None:
    """--align-rows of the commands that read scenes."""
    parser.add_argument('--align-rows', action='store_true',
                        help='estimate how far the rows of each scene are apart, and align its right image first')


def parameters_of(options: argparse.Namespace) -> MatcherParameters:
    """What --preset or --params, and --set say. ValueError names parameter, value and what is allowed."""
    return load_preset(options.params or options.preset).replace(**parse_changes(options.changes))


def parse_changes(changes: Sequence[str]) -> dict[str, bool | int | float | str]:
    """'name=value' texts as checked values by name; ValueError where one is not of that form or not allowed."""
    values = {}
    for change in changes:
        name, equals, text = change.partition('=')
        if not equals:
            raise ValueError(f'--set {cut(change)} is not allowed: write it as name=value')
        values[name] = parameter_info(name).parse(text)
    return values
