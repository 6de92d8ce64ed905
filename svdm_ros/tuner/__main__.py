"""`tuner`: move parameters in the browser and see the disparity change. `python -m svdm_ros.tuner`."""
from __future__ import annotations

import argparse
import importlib.util
import signal
import sys
from functools import partial
from pathlib import Path
from types import FrameType
from typing import TYPE_CHECKING

from svdm_core.evaluation.pair_folders import find_pairs
from svdm_core.evaluation.recordings import is_recording
from svdm_core.missing_modules import missing_line, not_installed
from svdm_core.runtime import configure
from svdm_core.shown import line

from ..command_line.parameters import node_parameters

if TYPE_CHECKING:
    from .source import Source

_HOST, _PORT = '127.0.0.1', 8080
_REFUSED = 2


def main() -> int:
    """Entry point; returns the exit code: 0 after SIGINT and SIGTERM, 2 with one line that says what was wrong."""
    options, ros_arguments = _parse(sys.argv[1:])
    try:
        return _run(options, ros_arguments)
    except ImportError as error:
        print(f'tuner: {missing_line(error)}', file=sys.stderr)
    except OSError as error:
        print(f'tuner: {line(f"{error.filename or 'files'}: {error.strerror or error}")}', file=sys.stderr)
    except ValueError as error:
        print(f'tuner: {line(error)}', file=sys.stderr)
    except KeyboardInterrupt:
        return 0
    return _REFUSED


def _run(options: argparse.Namespace, ros_arguments: list[str]) -> int:
    if importlib.util.find_spec('nicegui') is None:
        raise ImportError(not_installed(['nicegui']))
    if not options.folder.is_dir():
        raise ValueError(f'{options.folder}: there is no such folder, for --folder')
    configure()
    signal.signal(signal.SIGTERM, _interrupt)
    source = _source(options, ros_arguments)
    from .server import check_free, serve
    from .tuning_session import TuningSession

    check_free(options.host, options.port)
    source.start()
    session = TuningSession(source, options.folder, str(options.params or options.preset))
    try:
        serve(session, options.host, options.port)
    finally:
        source.stop()
    return 0


def _interrupt(_number: int, _frame: FrameType | None) -> None:
    raise KeyboardInterrupt


def _source(options: argparse.Namespace, ros_arguments: list[str]) -> Source:
    places = options.places
    _check_together(options, ros_arguments)
    if not places and not options.demo:
        from .node_source import NodeSource

        name = options.node if options.node.startswith('/') else f'/{options.node}'
        return NodeSource(name, ros_arguments)
    from . import feeds
    from .local_source import LocalSource
    from .row_sources import SeenRows, StillRows

    parameters = node_parameters(options.params or options.preset, options.changes)
    if options.demo:
        return LocalSource('Motorcycle, the demo pair', feeds.demo_pair, parameters, StillRows(), plays=False)
    if len(places) == 1:
        [bag] = places
        if not bag.exists():
            raise ValueError(f'{bag}: there is no such file or folder')
        if is_recording(bag):
            feed = partial(feeds.recorded, bag, (options.left, options.right), options.calib)
        elif options.left or options.right or options.calib:
            raise ValueError(f'{bag}: it is no recording, for which --left, --right and --calib are')
        else:
            feed = partial(feeds.folder_pairs, find_pairs([bag]))
        return LocalSource(bag.absolute().name, feed, parameters, SeenRows(), plays=True)
    left, right = places
    pair = feeds.file_pair(left, right, options.truth)  # read now: what is wrong with them is told at once
    return LocalSource(f'{left.name}, {right.name}', lambda: pair, parameters, StillRows(), plays=False)


def _check_together(options: argparse.Namespace, ros_arguments: list[str]) -> None:
    count = len(options.places)
    if count > 2 or (count and options.demo):
        raise ValueError('give a recording, a folder, or a left and a right image, or nothing for a live node')
    if options.truth and count != 2:
        raise ValueError('--truth is for a left and a right image')
    if (options.left or options.right or options.calib) and count != 1:
        raise ValueError('--left, --right and --calib are for a recording')
    if (count or options.demo) and (ros_arguments or options.node != _NODE):
        raise ValueError('--node and --ros-args are for a live node')
    if not count and not options.demo and (options.changes or options.params or options.preset != 'default'):
        raise ValueError('--preset, --params and --set are for a recording and for images: a live node has its own '
                         'parameters, and the page loads presets into it')


_NODE = '/disparity_node'


def _parse(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """The options, and --ros-args with what follows."""
    at = arguments.index('--ros-args') if '--ros-args' in arguments else len(arguments)
    return _parser().parse_args(arguments[:at]), arguments[at:]


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog='tuner', description='A page in the browser: move parameters and see the disparity change.',
        epilog='Topics of a live node are remapped with --ros-args -r OLD:=NEW, behind all other arguments, as for the '
               'node.')
    parser.add_argument('places', type=Path, nargs='*', metavar='BAG | FOLDER | LEFT RIGHT',
                        help='a recording, a folder with folders left and right, or two images; nothing: a live node')
    parser.add_argument('--demo', action='store_true', help='the demo pair, with its ground truth')
    parser.add_argument('--node', default=_NODE, metavar='NAME', help='the live node (%(default)s)')
    parser.add_argument('--truth', type=Path, metavar='FILE.pfm', help='true disparity of the two images')
    source = parser.add_mutually_exclusive_group()
    source.add_argument('--preset', default='default', metavar='P',
                        help='begin with a preset, or a .yaml file (default)')
    source.add_argument('--params', type=Path, metavar='FILE', help='begin with a parameter file, as ros2 takes it')
    parser.add_argument('--set', nargs='+', action='extend', default=[], dest='changes', metavar='NAME=VALUE',
                        help='change parameters of it')
    parser.add_argument('--left', metavar='TOPIC', help='left images of a recording with several pairs')
    parser.add_argument('--right', metavar='TOPIC', help='right images')
    parser.add_argument('--calib', type=Path, action='append', metavar='FILE',
                        help='calibration of a recording, as process_bag takes it')
    parser.add_argument('--folder', type=Path, default=Path(), metavar='FOLDER',
                        help='where parameter files are loaded from and saved to (this folder)')
    parser.add_argument('--host', default=_HOST, metavar='ADDRESS',
                        help='serve the page there (%(default)s, this machine only): whoever reaches it moves '
                             'parameters')
    parser.add_argument('--port', type=_port, default=_PORT, metavar='N', help='(%(default)s)')
    return parser


def _port(text: str) -> int:
    if not text.isdecimal() or not 1 <= int(text) <= 65535:
        raise argparse.ArgumentTypeError(f'{text!r} is not allowed: it must be an integer from 1 to 65535')
    return int(text)


if __name__ == '__main__':
    sys.exit(main())
