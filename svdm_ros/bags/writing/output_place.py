"""Where a bag appears once it is complete: nothing of the user's is in the way, or it is a bag that may be replaced."""
from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterable
from pathlib import Path

from svdm_core.files.user_files import RefusedFileError

from ..reading.metadata import METADATA_FILE, listed_files

SUMMARY_FILE, PREVIEW_FOLDER, PREVIEW_FILE = 'summary.json', 'preview', 'preview.mp4'
"""What process_bag writes beside the files of a bag."""


class PlaceTakenError(ValueError):
    """Something is where the bag should be, and stays there."""


def check_place(output: Path, force: bool) -> None:
    """Raise PlaceTakenError where something is at `output` that `force` does not replace.

    ValueError where the folder for it is missing.

    A bag is replaced with all that is in its folder; so a folder that holds anything else is not.
    """
    if not output.absolute().parent.is_dir():
        raise ValueError(f'{output}: there is no folder {output.parent}')
    if not os.path.lexists(output):
        return
    if not force:
        raise PlaceTakenError(f'{output} exists already: remove it, name another one, or give --force')
    if not (output / METADATA_FILE).is_file():
        raise PlaceTakenError(f'{output} is no bag (no metadata.yaml in it), --force replaces bags only: remove it, '
                              'or name another one')
    if foreign := _foreign(output):
        raise PlaceTakenError(f'{output} holds {foreign}, which is no part of a bag, and --force replaces bags only: '
                              'move that away, or name another output')


def check_apart(output: Path, inputs: Iterable[Path]) -> None:
    """Raise ValueError where an input is `output` or lies in it: it would go with what --force replaces."""
    place = output.resolve()
    for path in inputs:
        if path.resolve() == place:
            raise ValueError(f'{output} is the recording itself: name another output')
        if place in path.resolve().parents:
            raise ValueError(f'{path} is read and lies in the output {output}: name another output')


def put_in_place(folder: Path, output: Path, force: bool) -> None:
    """Give a finished bag its name. Raises PlaceTakenError as `check_place`; then it stays where it is.

    What had the name is moved aside, under a name nothing else has, and is removed once the new bag is there; where
    that fails it is moved back.
    """
    check_place(output, force)
    if not os.path.lexists(output):
        folder.rename(output)
        return
    aside = Path(tempfile.mkdtemp(prefix=f'{output.name}.replaced.', dir=output.parent))
    try:
        output.rename(aside / output.name)
        folder.rename(output)
    except BaseException:
        if os.path.lexists(aside / output.name) and not os.path.lexists(output):
            (aside / output.name).rename(output)
        if not any(aside.iterdir()):
            aside.rmdir()
        raise
    shutil.rmtree(aside)


def _foreign(bag: Path) -> str:
    """The name of something in the folder of a bag that is neither of the bag nor of process_bag; '' for none."""
    try:
        known = {METADATA_FILE, SUMMARY_FILE, PREVIEW_FILE, *listed_files(bag / METADATA_FILE)}
    except RefusedFileError as error:
        raise PlaceTakenError(f'{error}: what belongs to the bag cannot be told, so it is not replaced; remove it, '
                              'or name another output') from None
    for path in sorted(bag.iterdir()):
        is_preview = path.name == PREVIEW_FOLDER and is_pictures(path)
        if not is_preview and (path.name not in known or path.is_dir()):
            return path.name
    return ''


def is_pictures(folder: Path) -> bool:
    """Whether this is a folder of nothing but pictures named by their stamps, as --preview png makes it."""
    return folder.is_dir() and not folder.is_symlink() and all(
        path.suffix == '.png' and path.stem.isdecimal() and path.is_file() and not path.is_symlink()
        for path in folder.iterdir())
