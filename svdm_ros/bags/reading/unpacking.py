"""Packed bytes unpacked, no more than a recording can hold: a few can be packed so that they fill memory or disk."""
from __future__ import annotations

import bz2
import contextlib
import errno
import shutil
import tempfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from lz4.frame import LZ4FrameDecompressor

from .storage import DamageError, RecordingError

try:
    from compression import zstd  # type: ignore[import-not-found, unused-ignore]  # Python 3.14
except ImportError:
    from backports import zstd  # comes with rosbags

PACKED_SUFFIX = '.zstd'
ZSTD = b'\x28\xb5\x2f\xfd'
"""What zstd begins with; no CDR does."""
ALWAYS_ALLOWED = 2**28
"""Bytes that anything may unpack to."""
LARGEST_BLOCK = 2**30
"""Bytes that a chunk or message may unpack to; it is held in memory."""
_RATIO = 200
"""Beyond ALWAYS_ALLOWED; images get 1.5 to 20 times smaller."""
_BLOCK = 2**20
_HEADER = 18
"""Bytes of the longest header of a zstd frame."""
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)
_UNPACKERS: dict[str, Any] = {'zstd': zstd.ZstdDecompressor, 'lz4': LZ4FrameDecompressor, 'bz2': bz2.BZ2Decompressor}


def unpack_block(data: bytes, compression: str, size: int | None = None) -> bytes:
    """A chunk or a message. compression: '', 'zstd', 'lz4' or 'bz2'; size: as declared, None where it is not.

    Raises ValueError where it unpacks to another size, or to more than a recording can hold.
    """
    most = min(_allowed(len(data)), LARGEST_BLOCK)
    if (len(data) if not compression else size or 0) > most:
        raise ValueError(f'a block of {len(data)} bytes declares {size} bytes, {_too_much(most)}')
    if not compression:
        unpacked = data
    elif compression in _UNPACKERS:
        unpacked = _unpacked(data, compression, most if size is None else size)
    else:
        raise ValueError(f'its compression {compression[:50]!r} is none of {", ".join(_UNPACKERS)}')
    if size is not None and len(unpacked) != size:
        raise ValueError(f'a block unpacks to another size than the {size} bytes it declares: it is damaged')
    return unpacked


def _unpacked(data: bytes, compression: str, most: int) -> bytes:
    parts, room = [], most + 1
    while data and room > 0:
        unpacker = _UNPACKERS[compression]()
        parts.append(unpacker.decompress(data, max_length=room))
        room -= len(parts[-1])
        if not unpacker.eof and room > 0:
            raise ValueError(f'a block of {compression} is cut off')
        data = unpacker.unused_data or b''  # another frame
    if room <= 0:
        raise ValueError(f'a block unpacks to more than {most} bytes: it is damaged, or was made to fill memory')
    return parts[0] if len(parts) == 1 else b''.join(parts)


def _allowed(packed: int) -> int:
    return max(ALWAYS_ALLOWED, _RATIO * packed)


def _too_much(most: int) -> str:
    return f'at most {most} are allowed: it is damaged, or was made to fill memory or disk'


# Files that are packed as a whole


def unpacked_files(files: list[Path], stack: contextlib.ExitStack) -> dict[Path, Path | DamageError]:
    """Each file, or what it is unpacked to, in a folder that goes when `stack` is closed; or why it is damaged.

    Raises RecordingError where the temporary folder is full or cannot be used.
    """
    if not any(file.suffix == PACKED_SUFFIX for file in files):
        return {file: file for file in files}
    try:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix='svdm_bag_')))
    except OSError as error:
        raise RecordingError(f'{files[0]}: it is unpacked to a temporary folder, and there is none '
                             f'({error.strerror or error}): set TMPDIR to a folder with room') from None
    return {file: _unpacked_file(file, folder) if file.suffix == PACKED_SUFFIX else file for file in files}


def _unpacked_file(packed: Path, folder: Path) -> Path | DamageError:
    target = folder / packed.stem
    try:
        _unpack_file(packed, target)
    except DamageError as error:
        target.unlink(missing_ok=True)
        return error
    return target


def _unpack_file(packed: Path, target: Path) -> None:
    most = _allowed(packed.stat().st_size)
    with packed.open('rb') as file:
        declared = _declared(file.read(_HEADER))
    if declared > most:
        raise DamageError(f'it declares {declared} bytes unpacked, {_too_much(most)}')
    if declared > (free := shutil.disk_usage(target.parent).free):
        raise RecordingError(_no_room(packed, target.parent, f'{free} bytes are free, it needs {declared}'))
    try:
        for total, block in _blocks(packed):
            if total > most:
                raise DamageError(f'it unpacks to more than {most} bytes, {_too_much(most)}')
            _append(target, block)
    except OSError as error:
        if error.errno in _FULL:
            raise RecordingError(_no_room(packed, target.parent, str(error.strerror))) from None
        raise


def _declared(header: bytes) -> int:
    try:
        return int(zstd.get_frame_info(header).decompressed_size or 0)
    except zstd.ZstdError:
        return 0


def _blocks(packed: Path) -> Iterator[tuple[int, bytes]]:
    """What is unpacked, block by block, with the bytes so far."""
    total = 0
    with zstd.open(packed, 'rb') as source:
        while True:
            try:
                block = source.read(_BLOCK)
            except (zstd.ZstdError, EOFError) as error:
                raise DamageError(f'cut off or damaged ({error}): copy it anew') from None
            if not block:
                return
            total += len(block)
            yield total, block


def _append(target: Path, block: bytes) -> None:
    with target.open('ab', buffering=0) as file:
        left = memoryview(block)
        while left:
            left = left[file.write(left):]


def _no_room(packed: Path, folder: Path, reason: str) -> str:
    return (f'{packed}: it is unpacked to the temporary folder {folder.parent}, which has no room ({reason}): make '
            'room there, set TMPDIR to another folder, or unpack it with `zstd -d` and give that')
