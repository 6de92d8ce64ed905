"""Where the pairs of the page come from: what a live node, a recording and two image files have in common."""
from __future__ import annotations

from collections.abc import Mapping
from typing import Protocol

from ..frames.views import StereoFrame
from ..node.parameter_set import Value
from .shot import Shot


class Source(Protocol):
    """May be called from any thread. title: for the head of the page. plays: whether it can be paused and stepped."""

    @property
    def title(self) -> str: ...
    @property
    def plays(self) -> bool: ...

    def start(self) -> None:
        """Begin; ValueError where that cannot be."""
        ...

    def stop(self) -> None:
        """End, within a second."""
        ...

    def values(self) -> Mapping[str, Value]:
        """All parameters as they are; empty while that is not known."""
        ...

    def change(self, values: Mapping[str, Value]) -> str:
        """Change parameters, all or none; the reason where that is refused, else empty. May take seconds."""
        ...

    def latest(self) -> Shot | None:
        """The newest; None before there is one."""
        ...

    def figures(self) -> Mapping[str, str]:
        """Of the newest, and how long it took."""
        ...

    def trouble(self) -> str:
        """What is wrong, or waited for; empty where all is well."""
        ...

    def hold(self) -> StereoFrame | None:
        """A pair to compare settings on; None where none comes. May take seconds."""
        ...

    @property
    def is_playing(self) -> bool: ...

    def play(self, *, on: bool) -> None:
        """Go on, or pause."""
        ...

    def step(self) -> None:
        """One pair on."""
        ...
