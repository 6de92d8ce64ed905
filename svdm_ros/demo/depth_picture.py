"""The picture of what a robot gets: the depth of each pixel in metres, and the points as seen from elsewhere."""
from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..processes.scene import MOTORCYCLE, Scene
from .depth_view import Space
from .picture import DOTS_PER_INCH, UNKNOWN, pyplot

_SHOWN = (1, 99)  # %, of the depths; what is nearer or farther gets the last colour
_TURN, _TILT = -17.0, 12.0  # degrees, to the side and down
_BACKGROUND = 24  # grey level behind the points
_DOT = 3  # px a side, of a point
_FROM_ABOVE = 60_000  # points drawn


def draw_depth(path: Path, scene: Scene, space: Space, headline: str) -> None:
    """Write the PNG: the left image, its depth with a colour bar, the points turned, and the points from above."""
    figure, ((left, depth), (turned, above)) = pyplot.subplots(2, 2, figsize=(15, 9.9), layout='constrained')
    figure.suptitle(headline, fontsize=14)
    low, high = np.nanpercentile(space.depth, _SHOWN)

    left.imshow(scene.left[:, :, ::-1])
    left.set_title('What the left camera sees')
    depth.set_facecolor(UNKNOWN)
    shown = depth.imshow(space.depth, cmap='turbo_r', vmin=low, vmax=high, interpolation='nearest')
    depth.set_title('depth/image_rect: how far each pixel is; grey, not known well enough')
    figure.colorbar(shown, ax=depth, label='distance ahead of the camera (m)', extend='both', pad=0.02)
    turned.imshow(turned_view(space, high, scene.left.shape[:2]))
    turned.set_title('points2: the same scene from a place to the side and above')
    for ax in (left, depth, turned):
        ax.set_xticks([])
        ax.set_yticks([])

    some = np.random.default_rng(1).permutation(len(space.points))[:_FROM_ABOVE]
    some = some[np.argsort(-space.points[some, 1])]  # the highest are drawn last
    x, _, z = space.points[some].T
    above.scatter(x, z, c=space.colours[some] / 255, s=2, linewidths=0)
    above.plot(0, 0, '^', color='crimson', markersize=14, clip_on=False)
    above.annotate('left camera', (0, 0), (10, 0), textcoords='offset points', va='center', color='crimson')
    edges = (np.array([0, scene.left.shape[1]]) - MOTORCYCLE.cx) / MOTORCYCLE.focal_length
    for edge in edges:
        above.plot([0, edge * high], [0, high], '--', color='crimson', linewidth=1)
    for share, what in ((0.5, 'motorcycle'), (0.82, 'shelves and wall')):
        above.text(share * high * edges[1], share * high, f'   {what}', va='center')
    wide = 0.78 * high  # as broad as the images
    above.set(xlim=(-wide, wide), ylim=(-0.04 * high, 1.03 * high), aspect='equal', xlabel='to the right (m)',
              ylabel='ahead (m)', title='points2: from above; dashed, what the camera sees', facecolor='0.93')
    figure.savefig(path, dpi=DOTS_PER_INCH)
    pyplot.close(figure)


def turned_view(space: Space, far: float, size: tuple[int, int]) -> NDArray[np.uint8]:
    """The points up to `far` (m) as a camera sees them that has gone round their middle: uint8 (H, W, 3), of `size`."""
    near = space.points[:, 2] <= far
    points, colours = space.points[near].astype(np.float64), space.colours[near]
    middle = np.median(points, axis=0)
    x, y, z = (_rotation() @ (points - middle).T) + [[0.0], [0.0], [middle[2]]]
    height, width = size
    columns, rows = (np.rint(MOTORCYCLE.focal_length * part / z + half).astype(int)
                     for part, half in ((x, width / 2), (y, height / 2)))
    picture = np.full((height, width, 3), _BACKGROUND, np.uint8)
    covered = np.full((height, width), np.inf)
    for down, right in np.ndindex(_DOT, _DOT):
        to_row, to_column = rows + down, columns + right
        inside = np.flatnonzero((z > 0) & (to_row >= 0) & (to_row < height) & (to_column >= 0) & (to_column < width))
        inside = inside[np.argsort(-z[inside])]  # of equal places the last counts, which is the nearest
        places, nearest = np.unique(to_row[inside][::-1] * width + to_column[inside][::-1], return_index=True)
        chosen = inside[::-1][nearest]
        nearer = z[chosen] < covered.flat[places]
        covered.flat[places[nearer]] = z[chosen[nearer]]
        picture.reshape(-1, 3)[places[nearer]] = colours[chosen[nearer]]
    return picture


def _rotation() -> NDArray[np.float64]:
    """About the vertical axis, then about the one to the right."""
    turn, tilt = np.radians((_TURN, _TILT))
    about_y = np.array([[np.cos(turn), 0, np.sin(turn)], [0, 1, 0], [-np.sin(turn), 0, np.cos(turn)]])
    about_x = np.array([[1, 0, 0], [0, np.cos(tilt), -np.sin(tilt)], [0, np.sin(tilt), np.cos(tilt)]])
    return np.asarray(about_x @ about_y)
