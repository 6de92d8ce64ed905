"""Finds the scenes of a folder, in whichever layout it is."""
from __future__ import annotations

import dataclasses
import functools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from .datasets import MIDDLEBURY_WEIGHTS, StereoScene, middlebury_scenes, read_middlebury_scene
from .kitti import kitti_layout, kitti_names, read_kitti_scene

# Full-resolution pixels per pixel of the images.
RESOLUTIONS = {'Q': 4, 'H': 2, 'F': 1}
MIDDLEBURY = 'Middlebury'


@dataclasses.dataclass(frozen=True)
class SceneSet:
    """readers: name -> what reads the scene, in order; weights: share of a scene in the average, 1 where not named."""

    layout: str
    readers: Mapping[str, Callable[[], StereoScene]]
    weights: Mapping[str, float]

    def chosen(self, names: Sequence[str]) -> SceneSet:
        """The scenes `names`, all when empty. ValueError names one there is not, and those there are."""
        for name in names:
            if name not in self.readers:
                raise ValueError(f'there is no scene {name!r}; there are {", ".join(self.readers)}')
        wanted = {name: reader for name, reader in self.readers.items() if not names or name in names}
        return dataclasses.replace(self, readers=wanted)

    def resolution(self, wanted: str | None) -> str:
        """One of RESOLUTIONS: `wanted`, or Q for Middlebury and F for KITTI. ValueError for Q and H of KITTI."""
        if self.layout == MIDDLEBURY:
            return wanted or 'Q'
        if wanted not in (None, 'F'):
            raise ValueError(f'--resolution {wanted} is not allowed for {self.layout}: its images are of full '
                             'resolution, F')
        return 'F'


def find_scenes(folder: Path) -> SceneSet:
    """The scenes below `folder`. ValueError where there is none, naming the layouts looked for."""
    if not folder.is_dir():
        raise ValueError(f'{folder}: there is no such folder')
    for place in (folder / 'training', folder):
        layout = kitti_layout(place)
        if layout is not None:
            names = kitti_names(place, layout)
            if not names:
                raise ValueError(f'{place / layout.all}: no ground truth in it')
            return SceneSet(layout.name, {name: functools.partial(read_kitti_scene, place, layout, name)
                                          for name in names}, {})
    try:
        scenes = [folder] if (folder / 'im0.png').is_file() else middlebury_scenes(folder)
    except ValueError as error:
        raise ValueError(f'{error}; or training/ with KITTI\'s image_2, image_3, disp_noc_0, disp_occ_0 (2015) or '
                         'image_0, image_1, disp_noc, disp_occ (2012; colored_0, colored_1)') from None
    return SceneSet(MIDDLEBURY, {path.resolve().name: functools.partial(read_middlebury_scene, path)
                                 for path in scenes}, MIDDLEBURY_WEIGHTS)
