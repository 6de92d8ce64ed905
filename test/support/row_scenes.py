"""Pairs whose rows are apart by a known field, rendered from textures of several kinds."""
import cv2
import numpy as np

from svdm_core.row_alignment.alignment import RowAlignment, pixel_grid

HEIGHT, WIDTH = 200, 280
SEARCH = (0, 24)
"""min_disparity, num_disparities."""
_WIDE = 40
"""Columns of texture beyond the image, for the disparities."""


def _speckles(random):
    grey = cv2.GaussianBlur(random.normal(0, 1, (HEIGHT, WIDTH + _WIDE)), (0, 0), 1.6)
    return 128 + 40 * grey / grey.std()


def _leaves(random):
    """Rectangles over each other: corners and edges, flat between."""
    grey = np.full((HEIGHT, WIDTH + _WIDE), 128.0)
    for _ in range(700):
        x, y = random.integers(0, (WIDTH + _WIDE, HEIGHT))
        width, height = random.integers(5, 30, 2)
        grey[y:y + height, x:x + width] = random.uniform(20, 235)
    return cv2.GaussianBlur(grey, (0, 0), 0.9)


def _wall(texture, _random):
    return texture, np.full((HEIGHT, WIDTH), 9.0)


def _slanted(texture, _random):
    x, y = np.meshgrid(np.arange(WIDTH), np.arange(HEIGHT))
    return texture, 4 + 10 * x / WIDTH + 5 * y / HEIGHT


def _two_walls(texture, random):
    disparity = np.full((HEIGHT, WIDTH), 4.0)
    disparity[HEIGHT // 4:-HEIGHT // 4, WIDTH // 3:-WIDTH // 4] = 15 + random.uniform(0, 1)
    return texture, disparity


SCENES = {
    'speckles': (_speckles, _wall), 'leaves': (_leaves, _wall), 'slanted speckles': (_speckles, _slanted),
    'slanted leaves': (_leaves, _slanted), 'two walls': (_speckles, _two_walls),
}


def pair(scene, field, seed=0, noise=1.5):
    """Left and right (H, W) uint8. The left is rendered from the right, so what is hidden in it is seen by neither."""
    random = np.random.default_rng(seed)
    texture, depth = SCENES[scene]
    texture, disparity = depth(texture(random), random)
    left = _sampled(texture, disparity, 0.0)
    right = _sampled(texture, 0.0, -field_at_source(field))
    return tuple(np.clip(np.rint(image + random.normal(0, noise, image.shape)), 0, 255).astype(np.uint8)
                 for image in (left, right))


def truth(scene, seed=0):
    """Disparity (H, W) of the left image, px."""
    random = np.random.default_rng(seed)
    texture, depth = SCENES[scene]
    return depth(texture(random), random)[1]


def _sampled(texture, leftwards, down):
    """(H, W) of the texture: at (x - leftwards, y + down)."""
    x, y = np.broadcast_arrays(*pixel_grid(HEIGHT, WIDTH))
    at = (np.float32(x + _WIDE - leftwards), np.float32(y + down))
    return cv2.remap(texture.astype(np.float32), *at, cv2.INTER_LANCZOS4, borderMode=cv2.BORDER_REFLECT)


def field_at_source(field):
    """dy (H, W) that a pixel of the right image has come down by: at the row it came from, not where it is."""
    x, y = pixel_grid(HEIGHT, WIDTH)
    down = field.offsets(x, y)
    for _ in range(4):
        down = field.offsets(x, y - down)
    return down


def random_field(random, largest=2.0):
    """A quadratic field that is `largest` px, or less, somewhere in the image."""
    shape = RowAlignment(tuple(random.normal(0, 1, 6)), WIDTH, HEIGHT)
    peak = np.abs(shape.offsets(*pixel_grid(HEIGHT, WIDTH))).max()
    return RowAlignment(tuple(np.array(shape.coefficients) * random.uniform(0, largest) / peak), WIDTH, HEIGHT)


def difference(one, another):
    """Root mean square over the image, px; None is no field at all."""
    places = pixel_grid(HEIGHT, WIDTH)
    values = [0.0 if field is None else field.offsets(*places) for field in (one, another)]
    return float(np.sqrt(np.mean((values[0] - values[1])**2 + np.zeros((HEIGHT, WIDTH)))))
