"""Small .mcap files as other recorders write them, and as rosbags does not; from the specification."""
import struct

from rosbags.typesys import Stores, get_typestore

MAGIC = b'\x89MCAP0\r\n'
HEADER, FOOTER, SCHEMA, CHANNEL, MESSAGE, CHUNK, INDEX, CHUNK_INDEX, STATISTICS, DATA_END = (
    1, 2, 3, 4, 5, 6, 7, 8, 11, 15)
ROS2 = get_typestore(Stores.ROS2_JAZZY)


def record(kind, *parts):
    content = b''.join(parts)
    return struct.pack('<BQ', kind, len(content)) + content


def sized(content):
    content = content.encode() if isinstance(content, str) else content
    return struct.pack('<I', len(content)) + content


def definitions(channels):
    """channels: (topic, type, encoding, definition)."""
    for number, (topic, kind, encoding, text) in enumerate(channels, 1):
        form = {'cdr': 'ros2msg', 'ros1': 'ros1msg'}.get(encoding, 'jsonschema')
        yield record(SCHEMA, struct.pack('<H', number), sized(kind), sized(form), sized(text))
        yield record(CHANNEL, struct.pack('<HH', number, number), sized(topic), sized(encoding), sized(b''))


def message(channel, time_ns, data):
    return record(MESSAGE, struct.pack('<HIQQ', channel, 0, time_ns, time_ns), data)


def cdr_entries(messages):
    """Channels and entries (channel, time, bytes) of (topic, time, message)."""
    channels, entries = {}, []
    for topic, time_ns, content in messages:
        kind = content.__msgtype__
        channels.setdefault(topic, (topic, kind, 'cdr', ROS2.generate_msgdef(kind, ros_version=2)[0]))
        entries.append((list(channels).index(topic) + 1, time_ns, bytes(ROS2.serialize_cdr(content, kind))))
    return list(channels.values()), entries


def write_mcap(path, channels, entries, *, profile='ros2', chunked=True, per_chunk=8, indexed=lambda chunk: True,
               summary=True, pack=lambda data: ('', data)):
    """indexed: whether a chunk has a message index. pack: compression and bytes of a chunk."""
    data = MAGIC + record(HEADER, sized(profile), sized('test'))
    known, chunk_records, counts = b''.join(definitions(channels)), b'', {}
    for channel, _, _ in entries:
        counts[channel] = counts.get(channel, 0) + 1
    all_times = [time_ns for _, time_ns, _ in entries]
    if not chunked:
        data += known + b''.join(message(*entry) for entry in entries)
        entries = []
    for number, begin in enumerate(range(0, len(entries), per_chunk)):
        part = entries[begin:begin + per_chunk]
        chunk, indexes, kind, sizes = chunk_of(part, known if not number else b'', pack)
        place, offsets, start = len(data), b'', len(data) + len(chunk)
        data += chunk
        for channel, content in (indexes if indexed(number) else {}).items():
            offsets += struct.pack('<HQ', channel, len(data))
            data += record(INDEX, struct.pack('<H', channel), sized(content))
        times = [time_ns for _, time_ns, _ in part]
        chunk_records += record(CHUNK_INDEX, struct.pack('<QQQQ', min(times), max(times), place, len(chunk)),
                                sized(offsets), struct.pack('<Q', len(data) - start), sized(kind), sizes)
    data += record(DATA_END, bytes(4))
    begin = len(data)
    if summary:
        chunks, times = -(-len(entries) // per_chunk), sorted(all_times)
        data += known + chunk_records + record(
            STATISTICS, struct.pack('<QHIIIIQQ', sum(counts.values()), len(channels), len(channels), 0, 0, chunks,
                                    times[0], times[-1]),
            sized(b''.join(struct.pack('<HQ', *entry) for entry in counts.items())))
    data += record(FOOTER, struct.pack('<QQI', begin if summary else 0, 0, 0)) + MAGIC
    path.write_bytes(data)
    return path


def chunk_of(part, begin, pack):
    """A chunk, the index of its messages by channel, its compression, and its sizes as its own index has them."""
    content, indexes = begin, {}
    for channel, time_ns, data in part:
        indexes[channel] = indexes.get(channel, b'') + struct.pack('<QQ', time_ns, len(content))
        content += message(channel, time_ns, data)
    compression, packed = pack(content)
    times = [time_ns for _, time_ns, _ in part]
    head = struct.pack('<QQQI', min(times), max(times), len(content), 0)
    return (record(CHUNK, head, sized(compression), struct.pack('<Q', len(packed)), packed), indexes, compression,
            struct.pack('<QQ', len(packed), len(content)))
