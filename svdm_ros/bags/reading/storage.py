"""What a file of a recording gives, whatever its storage: channels, and messages in order of time."""
from __future__ import annotations

import contextlib
import dataclasses
import heapq
from collections.abc import Callable, Collection, Iterable, Iterator
from pathlib import Path
from typing import Literal, NamedTuple, Protocol

from rosbags.interfaces import MessageDefinition, Qos
from rosbags.rosbag2.metadata import parse_qos

from svdm_core.files.user_files import RefusedFileError
from svdm_core.shown import cut, shown

LAST_NS = 2**63 - 1
"""The latest time that a message can have."""


class RecordingError(ValueError):
    """A recording that cannot be read, at all or from some point on. The text is one line that says what to do."""


class DamagedFileError(RecordingError):
    """A file of a recording that is cut off, damaged, or none."""


class DamageError(ValueError):
    """What is wrong with a file, in words for its reader, without its name."""


@dataclasses.dataclass(frozen=True, slots=True)
class Channel:
    """Messages of one topic and type in one file.

    encoding: how messages are serialized. count: messages of it, by what the file tells. qos: offered when recorded.
    """

    id: int
    topic: str
    message_type: str
    encoding: Literal['cdr', 'ros1']
    definition: MessageDefinition
    count: int
    qos: tuple[Qos, ...] = ()


class StoredMessage(NamedTuple):
    """A message as it is in the file: recording time (ns), id of its channel, serialized content."""

    time_ns: int
    channel: int
    data: bytes


class StorageFile(Protocol):
    """An open file of a recording. left_out: lines on what in it is not read. end_ns: just after the last message."""

    path: Path
    channels: list[Channel]
    left_out: list[str]
    start_ns: int
    end_ns: int

    def messages(self, channels: Collection[int], start_ns: int, stop_ns: int) -> Iterator[StoredMessage]:
        """The messages of these channels, from start_ns on and before stop_ns, in order of time."""
        ...

    def close(self) -> None:
        """Close what is open."""
        ...


class Timed(Protocol):
    """Anything with a time, ns."""

    @property
    def time_ns(self) -> int:
        """When it was recorded."""
        ...


def merged[Message: Timed](parts: Iterable[tuple[int, Callable[[], Iterator[Message]]]]) -> Iterator[Message]:
    """The messages of parts in order of time; of one time in the order of the parts.

    parts: when each begins (ns), and what gives its messages; it is called when that is due.
    """
    for message in heapq.merge(*(_in_its_place(*part) for part in parts), key=lambda message: message.time_ns):
        if not isinstance(message, _Place):
            yield message


class _Place(NamedTuple):
    """Of a part that is not opened yet."""

    time_ns: int


def _in_its_place[Message: Timed](
    start_ns: int, messages: Callable[[], Iterator[Message]]
) -> Iterator[Message | _Place]:
    yield _Place(start_ns)
    yield from messages()


def left_out_line(topic: str, encoding: str, messages: int) -> str:
    """What is told of a topic that is serialized in a way that is not read."""
    return f'left out: {shown(topic)}, {messages} messages of encoding {shown(encoding)}: cdr and ros1 are read'


def qos_of(profiles: object) -> tuple[Qos, ...]:
    """Offered QoS, as metadata.yaml or a file has it; empty where it is none."""
    try:
        return tuple(parse_qos(profiles))  # type: ignore[arg-type]  # as it was found
    except Exception:  # it looks at no type before it uses it
        return ()


@contextlib.contextmanager
def told(path: Path) -> Iterator[None]:
    """Whatever the parsers raise on bytes that are no recording, as RecordingError in one line."""
    try:
        yield
    except RecordingError:
        raise
    except RefusedFileError as error:
        raise RecordingError(str(error)) from None
    except DamageError as error:
        raise DamagedFileError(f'{path}: {error}') from None
    except PermissionError:
        raise RecordingError(f'{path}: no permission to read it') from None
    except MemoryError:
        raise RecordingError(f'{path}: there is not enough memory to read it') from None
    except OSError as error:
        if error.errno is None:  # of a parser
            raise _damaged(path, error) from error
        raise RecordingError(f'{path}: cannot be read: {error.strerror}') from None
    except Exception as error:  # parsers fed with damaged bytes raise anything, TypeError and struct.error included
        raise _damaged(path, error) from error


def _damaged(path: Path, error: Exception) -> DamagedFileError:
    text = ' '.join(str(error).split()).rstrip('.') or type(error).__name__
    return DamagedFileError(f'{path}: damaged or no recording ({cut(text)})')
