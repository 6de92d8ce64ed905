"""Text from outside (files, messages, parameters, names) as a message shows it: printable, one line, short."""
from __future__ import annotations

import difflib
from collections.abc import Iterable
from typing import Any

_LONGEST = 200
_LONGEST_LINE = 2000
_LONGEST_NAME = 100


def shown(value: Any, longest: int = _LONGEST) -> str:
    """A value as `repr` has it, up to 200 characters of it; what is left out is told."""
    if isinstance(value, str):
        return _told(repr(value[:longest]), longest, value, len(value) > longest)
    try:
        return cut(repr(value), longest)
    except ValueError:  # Python writes no integers of more than some thousand digits
        return f'one of type {type(value).__name__}, too long to write'


def cut(text: str, longest: int = _LONGEST) -> str:
    """A text without quotes, in one line, up to 200 characters of it; what a terminal would obey is spelt out."""
    words = ' '.join(text[:4 * longest].split())
    return _told(_printable(words[:longest]), longest, text, len(text) > 4 * longest or len(words) > longest)


def line(text: object) -> str:
    """A whole message for the terminal or a log: printable, one line, up to 2000 characters."""
    told = str(text)
    left_out = f'... ({len(told)} characters)' if len(told) > _LONGEST_LINE else ''
    return _printable(told[:_LONGEST_LINE])[:_LONGEST_LINE] + left_out


def nearest(name: str, known: Iterable[str]) -> str:
    """The one of the known names that `name` was meant for; empty where none is near."""
    near = difflib.get_close_matches(name, known, n=1) if len(name) <= _LONGEST_NAME else []
    return near[0] if near else ''


def _told(beginning: str, longest: int, text: str, left_out: bool) -> str:
    if left_out or len(beginning) > longest + 2:
        return f'{beginning[:longest + 2]}... ({len(text)} characters)'
    return beginning


def _printable(text: str) -> str:
    if text.isprintable():
        return text
    return ''.join(one if one.isprintable() else ' ' if one.isspace() else repr(one)[1:-1] for one in text)
