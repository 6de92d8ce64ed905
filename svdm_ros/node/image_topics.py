"""Which topics the images come on, by the parameters input, transport and layout; and where they may be instead."""
from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator
from typing import NamedTuple

from ..frames.stereo_pairing import SideName
from .parameter_set import NodeParameters, node_parameter_table

SIDES: tuple[SideName, ...] = ('left', 'right')
_PARAMETERS = ('input', 'transport', 'layout')


class ImageTopics(NamedTuple):
    """How the images come; the fields are the parameters of these names."""

    input: str
    transport: str
    layout: str

    @classmethod
    def of(cls, parameters: NodeParameters) -> ImageTopics:
        return cls(parameters.input, parameters.transport, parameters.layout)

    @property
    def together(self) -> bool:
        """Whether one image holds both views."""
        return self.layout == 'side_by_side'

    @property
    def message_type(self) -> str:
        """sensor_msgs/msg/Image, or CompressedImage."""
        return 'sensor_msgs/msg/CompressedImage' if self.transport == 'compressed' else 'sensor_msgs/msg/Image'

    def name(self, side: SideName) -> str:
        """The relative topic of a side; the same for both where one image holds both views."""
        image = 'image_raw' if self.input == 'raw' else 'image_rect'
        name = image if self.together else f'{side}/{image}'
        return f'{name}/compressed' if self.transport == 'compressed' else name


def all_image_topics() -> Iterator[ImageTopics]:
    """Every way in which images can come."""
    choices = {info.name: info.choices for info in node_parameter_table()}
    return itertools.starmap(ImageTopics, itertools.product(*(choices[name] for name in _PARAMETERS)))


def other_topics_hint(current: ImageTopics, types_on: Callable[[str], set[str]]) -> str:
    """What may be the matter where no images come: empty, or what is published instead and which parameters take it.

    types_on: relative topic -> the types that are published on it.
    """
    for side in SIDES:
        wrong = types_on(current.name(side)) - {current.message_type}
        if wrong:
            return (f'{current.name(side)} is published as {", ".join(sorted(wrong))}, and this node takes '
                    f'{current.message_type} there')
    # Those that differ in the fewest parameters first.
    for other in sorted(all_image_topics(), key=lambda topics: sum(map(str.__ne__, topics, current))):
        if other != current and all(other.message_type in types_on(other.name(side)) for side in SIDES):
            changes = ' '.join(f'-p {name}:={value}' for name, value, now in zip(
                _PARAMETERS, other, current, strict=True) if value != now)
            names = ' and '.join(dict.fromkeys(other.name(side) for side in SIDES))
            return f'images are published on {names}: {changes} takes them'
    return ''
