"""A .db3 file of a rosbag2, with the write-ahead log that a recorder left beside it. Nothing is written there."""
from __future__ import annotations

import contextlib
import sqlite3
import sys
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import Any, cast

from rosbags.interfaces import MessageDefinition, MessageDefinitionFormat

from svdm_core.files.user_files import Limits, check_regular

from .storage import LAST_NS, Channel, DamageError, StoredMessage, left_out_line, qos_of
from .unpacking import LARGEST_BLOCK

MAGIC = b'SQLite format 3\0'
_FORMATS = {'ros2msg': MessageDefinitionFormat.MSG, 'ros2idl': MessageDefinitionFormat.IDL}
_NO_DEFINITION = MessageDefinition(MessageDefinitionFormat.NONE, '')
_TABLES = ('SELECT count(*) FROM sqlite_master WHERE type = "table" AND name IN ("messages", "topics") '
           'AND sql NOT LIKE "%virtual table%"')
_COUNTS = ('SELECT topic_id, count(*), min(timestamp), max(timestamp) FROM messages WHERE (timestamp < 0) IS NOT 1 '
           'GROUP BY topic_id')
_BEFORE_0 = 'SELECT count(*) FROM messages WHERE timestamp < 0'


def log_of(path: Path) -> Path:
    """Where SQLite keeps what it has not written into the file yet; where `path` is a symlink, beside its target."""
    file = path.resolve()
    return file.with_name(f'{file.name}-wal')


class SqliteFile:
    """An open .db3 file, see StorageFile. Raises DamageError or sqlite3.Error where it is none."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.channels: list[Channel] = []
        self.left_out: list[str] = []
        self.start_ns = self.end_ns = 0
        log = log_of(path)
        self._has_log = log.exists()
        beside = path.with_name(f'{path.name}-wal')
        if not self._has_log and beside.exists():
            raise DamageError(f'it is a symlink, and its log {beside.name} is not beside {path.resolve()}, where '
                              'SQLite looks for it: copy both into one folder')
        if self._has_log:
            check_regular(log, Limits(sys.maxsize))
            self._has_log = log.stat().st_size > 0
        with contextlib.closing(self._connect()) as database:
            self._read(database)

    def messages(self, channels: Collection[int], start_ns: int, stop_ns: int) -> Iterator[StoredMessage]:
        """The messages of these channels, from start_ns on and before stop_ns, in order of time."""
        wanted = ','.join(str(int(channel)) for channel in channels)
        with contextlib.closing(self._connect()) as database:
            # Contents are fetched one by one: a file without an index is sorted, and that would go through all of them.
            rows = database.execute(
                f'SELECT rowid, timestamp, topic_id FROM messages WHERE topic_id IN ({wanted}) AND timestamp >= ? '
                'AND timestamp <= ? ORDER BY timestamp, rowid', (max(start_ns, 0), min(stop_ns - 1, LAST_NS)))
            for row, time_ns, channel in rows:
                [data] = database.execute('SELECT data FROM messages WHERE rowid = ?', (row,)).fetchone()
                if not isinstance(time_ns, int) or not isinstance(data, bytes):
                    raise ValueError(f'message {row} has a time or content of another kind')
                yield StoredMessage(time_ns, channel, data)

    def close(self) -> None:
        """Nothing is open but while messages are read."""

    def _connect(self) -> sqlite3.Connection:
        """Of a file that no one else writes to. Without locks SQLite needs no file of its own to read the log."""
        how = 'mode=ro&vfs=unix-none' if self._has_log else 'immutable=1'
        database = sqlite3.connect(f'{self.path.resolve().as_uri()}?{how}', uri=True, isolation_level=None,
                                   check_same_thread=False)
        database.setconfig(sqlite3.SQLITE_DBCONFIG_NO_CKPT_ON_CLOSE, True)
        database.setlimit(sqlite3.SQLITE_LIMIT_LENGTH, LARGEST_BLOCK)
        database.execute('PRAGMA locking_mode = EXCLUSIVE').fetchall()
        database.execute('PRAGMA trusted_schema = OFF')
        return database

    def _read(self, database: sqlite3.Connection) -> None:
        if database.execute(_TABLES).fetchone() != (2,):
            raise DamageError('no rosbag2, or cut off (missing tables): copy it anew')
        counts: dict[Any, tuple[int, int, int]] = {row[0]: row[1:] for row in database.execute(_COUNTS)}
        if not all(isinstance(time_ns, int) for _, *times in counts.values() for time_ns in times):
            raise ValueError('times of messages are no integers')
        if counts:
            self.start_ns = min(start for _, start, _ in counts.values())
            self.end_ns = max(end for _, _, end in counts.values()) + 1
        definitions = _definitions(database)
        for channel, topic, message_type, encoding, qos in _topics(database):
            count = counts.pop(channel, (0, 0, 0))[0]
            if encoding == 'cdr':
                self.channels.append(Channel(channel, topic, message_type, 'cdr', definitions.get(
                    message_type, _NO_DEFINITION), count, qos_of(qos)))
            else:
                self.left_out.append(left_out_line(topic, encoding, count))
        if counts:
            self.left_out.append(f'left out: {sum(row[0] for row in counts.values())} messages of topics that the file '
                                 'does not name')
        [before] = database.execute(_BEFORE_0).fetchone()
        if before:
            self.left_out.append(f'left out: {before} messages with recording times below 0')


def _columns(database: sqlite3.Connection, table: str) -> set[str]:
    return {row[1] for row in database.execute(f'PRAGMA table_info({table})')}


def _topics(database: sqlite3.Connection) -> Iterator[tuple[int, str, str, str, str]]:
    """Id, name, type, encoding and offered QoS; QoS since version 2 of the tables."""
    qos = 'offered_qos_profiles' if 'offered_qos_profiles' in _columns(database, 'topics') else '""'
    for row in database.execute(f'SELECT id, name, type, serialization_format, {qos} FROM topics ORDER BY id'):
        if not isinstance(row[0], int) or not all(isinstance(value, str) for value in row[1:4]):
            raise ValueError('a topic has a name or type of another kind')
        yield cast(tuple[int, str, str, str, str], row)


def _definitions(database: sqlite3.Connection) -> dict[str, MessageDefinition]:
    """By type; since version 4 of the tables."""
    if 'encoded_message_definition' not in _columns(database, 'message_definitions'):
        return {}
    rows = database.execute('SELECT topic_type, encoding, encoded_message_definition FROM message_definitions '
                            'ORDER BY id DESC')
    return {name: MessageDefinition(_FORMATS[encoding], text) for name, encoding, text in rows
            if encoding in _FORMATS and isinstance(text, str)}
