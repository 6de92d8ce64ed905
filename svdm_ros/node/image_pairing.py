"""The images of the two cameras as they come, paired: what is dropped on the way is counted and told."""
from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from typing import TYPE_CHECKING

from svdm_core.memory import in_gigabytes
from svdm_core.runtime.free_memory import free_memory

from ..frames.stereo_pairing import Pair, SideName, StereoPairer
from .image_topics import SIDES
from .log_lines import Line, LogLines

if TYPE_CHECKING:
    from sensor_msgs.msg import CompressedImage, Image

    from .parameter_set import NodeParameters

    type AnyImage = Image | CompressedImage

_MOST_WAITING = 512 << 20
"""Bytes, a camera; an eighth of what is free where that is less."""


class ImagePairing:
    """Used by one thread."""

    def __init__(self, log: LogLines) -> None:
        self._log = log
        self._topics: Mapping[SideName, str] = {}
        self._dropped_before: Counter[str] = Counter()
        self._pairer: StereoPairer[AnyImage] = StereoPairer()

    def begin(self, topics: Mapping[SideName, str], parameters: NodeParameters) -> None:
        """Begin anew, with the images of other topics: full name, by side."""
        self._dropped_before.update(self._drops_of_pairer())
        self._topics = topics
        self._pairer = StereoPairer(most_bytes=most_waiting(free_memory()))
        self.use(parameters)

    def use(self, parameters: NodeParameters) -> None:
        """The parameters from now on."""
        self._pairer.tolerance_ns, self._pairer.queue_size = parameters.tolerance_ns, parameters.queue_size

    @property
    def tolerance_ns(self) -> int:
        return self._pairer.tolerance_ns

    @property
    def dropped(self) -> Mapping[str, int]:
        """Images dropped so far, by reason."""
        dropped = self._drops_of_pairer()
        dropped.update(self._dropped_before)
        return dropped

    def take_closest_gap(self) -> int | None:
        """As the pairer's."""
        return self._pairer.take_closest_gap()

    def add(self, side: SideName, image: AnyImage) -> list[Pair[AnyImage]]:
        """Take in one image; the pairs that are now certain, oldest first."""
        jumps, dropped = self._pairer.jumps, self._pairer.beyond_memory[side]
        pairs = self._pairer.add(side, stamp_ns(image), image, len(image.data))
        if self._pairer.jumps != jumps:
            self._log.say(Line('jump', f'the stamps of {self._topics[side]} jumped back (a looping bag?): going on'))
        if self._pairer.beyond_memory[side] != dropped:
            self._log.complain(Line(f'waiting {side}', self._waiting_text(side)))
        return pairs

    def _waiting_text(self, side: SideName) -> str:
        other = next(self._topics[name] for name in SIDES if name != side)
        return (f'images of {self._topics[side]} that wait for their partner took more than '
                f'{in_gigabytes(self._pairer.most_bytes)}, the oldest were dropped: look why {other} does not bring '
                'their partners, or set queue_size lower')

    def _drops_of_pairer(self) -> Counter[str]:
        return Counter({f'{reason} {side}': count for reason, counts in (
            ('unpaired', self._pairer.unpaired), ('waiting memory', self._pairer.beyond_memory))
            for side, count in counts.items()})


def stamp_ns(image: AnyImage) -> int:
    """The stamp of an image, ns."""
    return int(image.header.stamp.sec) * 1_000_000_000 + int(image.header.stamp.nanosec)


def most_waiting(free: int | None) -> int:
    """Bytes that the waiting images of one camera may take, where `free` bytes are free (None: not known)."""
    return _MOST_WAITING if free is None else min(_MOST_WAITING, free // 8)
