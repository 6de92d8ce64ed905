"""Scenes whose rows are aligned before they are matched, each by an alignment of its own."""
from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from typing import Any

from ..row_alignment.alignment import NOTHING_TO_CORRECT, RowAlignment
from ..row_alignment.estimation import estimate_row_alignment
from .datasets import StereoScene


class SceneAligner:
    """Aligns scenes, and remembers by what: `found` has each scene's alignment, None where none could be told."""

    def __init__(self) -> None:
        self.found: dict[str, RowAlignment | None] = {}

    def reader(self, read: Callable[[], StereoScene]) -> Callable[[], StereoScene]:
        """Reads a scene and aligns it."""
        return lambda: self.aligned(read())

    def aligned(self, scene: StereoScene) -> StereoScene:
        """The scene with its right image resampled; the ground truth, of the left image, stays right."""
        rows = estimate_row_alignment((scene.left, scene.right), 0, scene.num_disparities)
        self.found[scene.name] = rows
        return scene if rows is None else dataclasses.replace(scene, right=rows.apply(scene.right))

    def document(self) -> dict[str, Any]:
        """What --json writes: scene -> alignment, null where the images were left as they are."""
        return {name: None if rows is None else rows.as_dict() for name, rows in self.found.items()}


def alignment_line(found: Mapping[str, Any]) -> str:
    """What was aligned, for the terminal and for pages; found: as `SceneAligner.document` has it."""
    told = [f'{name} {rows["residual_before"]:.2f} to {rows["residual_after"]:.2f}'
            for name, rows in found.items() if rows is not None]
    left = [name for name, rows in found.items() if rows is None]
    parts = [f'rows aligned in {len(told)} of {len(found)} scenes']
    if told:
        parts.append(f' (rms of the vertical offsets, px: {", ".join(told)})')
    if left:
        parts.append(f'; as they are, {NOTHING_TO_CORRECT}: {", ".join(left)}')
    return ''.join(parts)
