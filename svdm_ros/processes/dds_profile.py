"""The Fast DDS profile with room for images: fitted to this machine, and for processes that nobody has given one."""
from __future__ import annotations

import contextlib
import os
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path

from svdm_core.presets import PresetNotFoundError, preset_folder

SHARED_MEMORY = Path('/dev/shm')
SEGMENT_BYTES = 32 << 20  # as config/fastdds.xml has it
SMALLEST_SEGMENT_BYTES = 4 << 20  # a pair of the demo's images has 2.2 MB
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


def write_profile(shipped: Path, target: Path) -> Path:
    """The Fast DDS profile for this machine: as shipped, but with less where /dev/shm is small (containers)."""
    text = shipped.read_text()
    target.write_text(text.replace(f'>{SEGMENT_BYTES}<', f'>{segment_bytes(shutil.disk_usage(SHARED_MEMORY).free)}<'))
    return target


def segment_bytes(free: int) -> int:
    """Bytes of shared memory a process takes where `free` bytes are left: there are three, and a reserve."""
    return max(SMALLEST_SEGMENT_BYTES, min(SEGMENT_BYTES, free // 4))


def _shipped() -> Path | None:
    """It lies beside the presets."""
    try:
        path = preset_folder() / _NAME
    except PresetNotFoundError:
        return None
    return path if path.is_file() else None
