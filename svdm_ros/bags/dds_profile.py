"""The Fast DDS profile with room for images, for processes that nobody has given one."""
from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

from svdm_core.presets import PresetNotFoundError, preset_folder

from ..demo.processes import write_profile

_VARIABLE = 'FASTRTPS_DEFAULT_PROFILES_FILE'
_NAME = 'fastdds.xml'


@contextlib.contextmanager
def image_profile() -> Iterator[None]:
    """While participants are made: the profile that comes with the package, fitted to this machine, unless one is set.

    Without it, images beyond 512 KiB arrive late or not at all.
    """
    shipped = _shipped()
    if _VARIABLE in os.environ or shipped is None:
        yield
        return
    with tempfile.TemporaryDirectory(prefix='svdm_dds_') as folder:
        os.environ[_VARIABLE] = str(write_profile(shipped, Path(folder) / _NAME))
        try:
            yield
        finally:
            del os.environ[_VARIABLE]


def _shipped() -> Path | None:
    """It lies beside the presets."""
    try:
        path = preset_folder() / _NAME
    except PresetNotFoundError:
        return None
    return path if path.is_file() else None
