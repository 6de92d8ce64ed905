"""The message types of a recording, by the definitions in its files."""
from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterable, Iterator

from rosbags.convert.converter import generate_message_converter
from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat
from rosbags.interfaces.typing import Typesdict
from rosbags.typesys import Stores, get_types_from_idl, get_types_from_msg, get_typestore
from rosbags.typesys.msg import normalize_msgtype
from rosbags.typesys.store import Typestore

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
        self._other: set[tuple[str, MessageDefinition]] = set()
        jazzy = get_typestore(Stores.ROS2_JAZZY)
        own: dict[str, Typesdict] = {'cdr': {}, 'ros1': {}}
        known: dict[tuple[str, MessageDefinition], Typesdict] = {}
        for channel in channels:
            key = channel.message_type, channel.definition
            if key not in known:
                known[key] = _definitions(*key)
                if channel.encoding == 'cdr' and _is_another(channel, known[key], jazzy):
                    self._other.add(key)
                    known[key] = {}
            own[channel.encoding].update(known[key])
        self._ros1 = get_typestore(Stores.EMPTY)
        self._ros1.register(own['ros1'])
        self.typestore = _merged(jazzy, own)
        self._converters: dict[str, Callable[[bytes], memoryview]] = {}

    def lacks(self, channel: Channel) -> bool:
        """Whether messages of the channel cannot be had as those of ROS 2."""
        if not is_type(channel.message_type) or (channel.message_type, channel.definition) in self._other:
            return True
        return channel.encoding == 'ros1' and self._converter(normalize_msgtype(channel.message_type)) is None

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
    name = normalize_msgtype(channel.message_type)
    return _USED.index(name) if name in _USED else len(_USED)


def is_type(name: str) -> bool:
    """Whether it is the name of a message type, 'sensor_msgs/msg/Image' or as ROS 1 has it.

    rosbags writes names of types into Python code that it runs, so that nothing else may get there.
    """
    parts = name.split('/')
    return name.isascii() and len(parts) > 1 and all(part.isidentifier() for part in parts)


def _is_another(channel: Channel, types: Typesdict, jazzy: Typestore) -> bool:
    """Whether it is a type that is used, but with other fields: of a damaged definition, or of another package."""
    if normalize_msgtype(channel.message_type) not in _USED:
        return False
    is_idl = channel.definition.format == MessageDefinitionFormat.IDL  # which has other names for the same types
    return any(_fields(types, name, is_idl) != _fields(jazzy.fielddefs, name, is_idl) for name in types)


def _fields(types: Typesdict, name: str, only_names: bool) -> list[object]:
    fields = types[name][1] if name in types else []
    return [field[0] if only_names else field for field in fields]


def _merged(jazzy: Typestore, own: dict[str, Typesdict]) -> Typestore:
    """A ROS 2 recording is read by its own definitions; ROS 1 has other ones of the same names."""
    if all(jazzy.fielddefs.get(name) == definition for name, definition in own['cdr'].items()) and not own['ros1']:
        return jazzy
    store = get_typestore(Stores.EMPTY)
    store.register({**own['ros1'], **jazzy.fielddefs, **own['cdr']})
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
