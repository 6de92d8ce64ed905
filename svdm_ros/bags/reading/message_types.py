"""The message types of a recording, by the definitions in its files."""
from __future__ import annotations

import contextlib
import functools
from collections.abc import Callable, Iterable, Iterator
from typing import Any

from rosbags.convert.converter import generate_message_converter
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.msg import normalize_msgtype
from rosbags.typesys.store import Typestore

from svdm_core.shown import shown

from .storage import Channel

_USED = ('sensor_msgs/msg/Image', 'sensor_msgs/msg/CompressedImage', 'sensor_msgs/msg/CameraInfo',
         'stereo_msgs/msg/DisparityImage')
"""Types whose fields are asked for by name, images first; messages of other types are handed on."""
_LONGEST = 2**18
"""Characters of a definition with all that it needs; those of ROS have some thousand."""
_BETWEEN = '=' * 80 + '\n'


class RecordedTypes:
    """The types of the channels.

    typestore: of all types, as ROS 2 has them: by their definitions in ROS 2 recordings, else as in ROS 2 Jazzy.
    """

    def __init__(self, channels: Iterable[Channel]) -> None:
        jazzy = get_typestore(Stores.ROS2_JAZZY)
        own = {'cdr': _Definitions(_needed()), 'ros1': _Definitions({})}
        self._other: dict[tuple[str, str, MessageDefinition], str] = {}
        known: set[tuple[str, str, MessageDefinition]] = set()
        for channel in sorted(channels, key=rank_of):  # what is used decides on names that are defined twice
            key = _key(channel)
            if key not in known:
                known.add(key)
                if another := own[channel.encoding].add(channel.definition.format, _definitions(*key[1:])):
                    self._other[key] = another
        self._ros1 = get_typestore(Stores.EMPTY)
        self._ros1.register(own['ros1'].types)
        self.typestore = _merged(jazzy, own['cdr'].types, own['ros1'].types)
        self._converters: dict[str, Callable[[bytes], memoryview]] = {}

    def lacks(self, channel: Channel) -> str:
        """Why messages of the channel cannot be had as those of ROS 2; '' where they can."""
        if another := self._other.get(_key(channel)):
            return f'which defines {shown(another)} otherwise than ' + (
                'ROS 2 does' if channel.encoding == 'cdr' and another in _needed() else 'another topic does')
        if not is_type(channel.message_type) or (
                channel.encoding == 'ros1' and self._converter(normalize_msgtype(channel.message_type)) is None):
            return 'whose definition cannot be read, or is none of ROS 2'
        return ''

    def as_ros2(self, channel: Channel, data: bytes) -> bytes:
        """A message of the channel as CDR."""
        if channel.encoding == 'cdr':
            return data
        convert = self._converter(normalize_msgtype(channel.message_type))
        assert convert is not None  # else it is lacked
        return bytes(convert(data))

    def _converter(self, name: str) -> Callable[[bytes], memoryview] | None:
        if name not in self._converters:
            try:
                with contextlib.redirect_stdout(None):  # it prints what it converts
                    self._converters[name] = generate_message_converter(
                        self._ros1, self.typestore, name, name, {}, src_is2=False, dst_is2=True)
            except Exception:  # of a definition that is none, anything
                return None
        return self._converters[name]


def rank_of(channel: Channel) -> int:
    """Place of its type among those that are used; behind them for all others."""
    name = normalize_msgtype(channel.message_type) if is_type(channel.message_type) else ''
    return _USED.index(name) if name in _USED else len(_USED)


def is_type(name: str) -> bool:
    """Whether it is the name of a message type, 'sensor_msgs/msg/Image' or as ROS 1 has it.

    rosbags writes names of types into Python code that it runs, so that nothing else may get there.
    """
    parts = name.split('/')
    return name.isascii() and len(parts) > 1 and all(part.isidentifier() for part in parts)


class _Definitions:
    """Types of one encoding, by name; one definition of each."""

    def __init__(self, fixed: Typesdict) -> None:
        """fixed: those that no channel may define otherwise."""
        self.types: Typesdict = {}
        self._fixed = fixed
        self._formats: dict[str, MessageDefinitionFormat] = {}

    def add(self, form: MessageDefinitionFormat, types: Typesdict) -> str:
        """Take them in; none where one has other fields than there are by that name already, which is returned."""
        for name, definition in types.items():
            known = self._fixed.get(name) or self.types.get(name)
            known_form = MessageDefinitionFormat.MSG if name in self._fixed else self._formats.get(name)
            if known and _fields(known, form == known_form) != _fields(definition, form == known_form):
                return name
        for name, definition in types.items():
            self.types.setdefault(name, definition)
            self._formats.setdefault(name, form)
        return ''


def _fields(definition: Any, with_types: bool) -> list[object]:
    """Names of the fields; and their types, which are the same in texts of one format only."""
    return [field if with_types else field[0] for field in definition[1]]


@functools.cache
def _needed() -> Typesdict:
    """The types that are used, with those that they need, in ROS 2 Jazzy."""
    jazzy = get_typestore(Stores.ROS2_JAZZY)
    needed: Typesdict = {}
    for name in _USED:
        needed.update(get_types_from_msg(jazzy.generate_msgdef(name, ros_version=2)[0], name))
    return needed


def _key(channel: Channel) -> tuple[str, str, MessageDefinition]:
    return channel.encoding, channel.message_type, channel.definition


def _merged(jazzy: Typestore, cdr: Typesdict, ros1: Typesdict) -> Typestore:
    """A ROS 2 recording is read by its own definitions; ROS 1 has other ones of the same names."""
    if all(jazzy.fielddefs.get(name) == definition for name, definition in cdr.items()) and not ros1:
        return jazzy
    store = get_typestore(Stores.EMPTY)
    store.register({**ros1, **jazzy.fielddefs, **cdr})
    return store


def _definitions(message_type: str, definition: MessageDefinition) -> Typesdict:
    """The type and those it needs; nothing where the definition cannot be read."""
    if definition.format == MessageDefinitionFormat.NONE or not is_type(message_type) or len(
            definition.data) > _LONGEST:
        return {}
    types: Typesdict = {}
    try:
        for text in _parts(definition):
            types.update(get_types_from_msg(text, message_type) if definition.format == MessageDefinitionFormat.MSG
                         else get_types_from_idl(text))
        if not all(is_type(name) for name in types):
            return {}
        get_typestore(Stores.EMPTY).register(types)
    except Exception:  # parsers fed with damaged text raise anything
        return {}
    return types


def _parts(definition: MessageDefinition) -> Iterator[str]:
    """Texts in IDL stand one behind the other, each with a line that names it."""
    if definition.format == MessageDefinitionFormat.IDL and definition.data.startswith(f'{_BETWEEN}IDL: '):
        yield from (part.partition('\n')[2] for part in definition.data.split(_BETWEEN)[1:])
    else:
        yield definition.data
