"""Stage 2: whose costs are added to a pixel's own. A new way is a module here and a line in `AGGREGATIONS`."""
from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, NamedTuple

if TYPE_CHECKING:
    from .aggregation import StripeAggregation


class Aggregation(NamedTuple):
    """place: 'module:class', a subclass of `aggregation.StripeAggregation`, imported when it is first used, as that
    takes a second. meaning: whose costs are added, for the parameter's description."""

    place: str
    meaning: str

    def load(self) -> type[StripeAggregation]:
        """The class."""
        module, _, name = self.place.partition(':')
        found: type[StripeAggregation] = getattr(importlib.import_module(module), name)
        return found


AGGREGATIONS = {
    'tree': Aggregation(f'{__name__}.stripe_trees:TreeAggregation',
                        'all others along a minimum spanning tree (the paper)'),
    'box': Aggregation(f'{__name__}.box:BoxAggregation', 'the 3x3 box around it'),
}
