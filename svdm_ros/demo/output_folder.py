"""The folder the demo writes to: its own, recognised by a marker, so that nobody else's files are overwritten."""
from __future__ import annotations

import shutil
from pathlib import Path

from ..processes.children import RunError

MARKER = '.written_by_svdm_demo'
WRITTEN = (
    'summary.json', 'comparison.png', 'depth.png', 'node.log', 'publisher.log', 'warm_up.log', 'fastdds.xml', 'ros_log'
)


def prepare_output_folder(folder: Path) -> Path:
    """Make `folder`, or empty it of what an earlier demo wrote; returns its absolute path.

    Raises RunError where it holds something that no demo put there.
    """
    folder = folder.resolve()
    if folder.exists() and not folder.is_dir():
        raise RunError(f'{folder} is a file: choose another folder with --output')
    if folder.is_dir() and not (folder / MARKER).exists() and any(folder.iterdir()):
        raise RunError(f'{folder} holds files that are not from this demo: choose another folder with --output')
    try:
        folder.mkdir(parents=True, exist_ok=True)
        (folder / MARKER).touch()
        for name in WRITTEN:
            _remove(folder / name)
    except OSError as error:
        raise RunError(f'cannot write to {folder}: {error.strerror}') from None
    return folder


def _remove(path: Path) -> None:
    if path.is_dir():
        shutil.rmtree(path)
    else:
        path.unlink(missing_ok=True)
