"""Text from outside (files, messages, parameters, names) as a message shows it: printable, one line, short."""
from __future__ import annotations

from collections.abc import Callable
from typing import Any

_LONGEST = 200


def shown(value: Any) -> str:
    """A value as `repr` has it, up to 200 characters of it; what is left out is told."""
    if isinstance(value, str):
        return _cut(value, repr)
    try:
        return cut(repr(value))
    except ValueError:  # Python writes no integers of more than some thousand digits
        return f'a {type(value).__name__} too long to write'


def cut(text: str) -> str:
    """A text without quotes, up to 200 characters of it; what a terminal would obey is spelt out."""
    return _cut(text, _printable)


def _cut(text: str, show: Callable[[str], str]) -> str:
    line = ' '.join(text[:4 * _LONGEST].split())
    left_out = len(text) > 4 * _LONGEST or len(line) > _LONGEST
    return f'{show(line[:_LONGEST])}{f"... ({len(text)} characters)" if left_out else ""}'


def _printable(text: str) -> str:
    return text if text.isprintable() else ''.join(one if one.isprintable() else repr(one)[1:-1] for one in text)
