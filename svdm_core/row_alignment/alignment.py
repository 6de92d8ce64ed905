"""The vertical offset of a pair as a smooth field over the right image, and the resampling that takes it away."""
from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any, NamedTuple, Self

import numpy as np
import yaml
from numpy.typing import ArrayLike, NDArray

from ..files.output_files import write_outputs
from ..files.user_files import SETTINGS, RefusedFileError, read_yaml
from ..kernels.arrays import Float64, Image
from ..shown import shown
from .resampling import RowMap, resampled, row_map

TERMS = ('1', 'u', 'v', 'uv', 'v^2', 'u^2')
"""Of the field, in the order of the coefficients."""
NOTHING_TO_CORRECT = 'nothing significant to correct, or too few points to tell'
"""What is said where there is no alignment; `report` tells which of the two."""
LARGEST_COEFFICIENT = 100.0
"""px; far beyond what a pair called rectified can have."""
LARGEST_SIDE = 32766
"""px; OpenCV resamples no larger images."""
_MOST_POINTS = 10**9
_HEADING = 'row_alignment'
_COMMENT = '# How far the rows of a stereo pair are apart, for `svdm match --align-rows`.\n'


@dataclasses.dataclass(frozen=True, slots=True)
class RowAlignment:
    """dy(x, y), px: row y of the left image is seen at row y + dy of column x of the right image.

    dy = coefficients . (1, u, v, uv, v^2, u^2) with u = (x - width / 2) / (width / 2), v = (y - height / 2) / (height
    / 2). coefficients: px. width, height: of the images, px. points: how many were measured. residual_before,
    residual_after: px, root mean square over the points that the fit kept, without and with the field. Raises
    ValueError, in one line, where a value is not a finite number in its range.
    """

    coefficients: tuple[float, float, float, float, float, float]
    width: int
    height: int
    points: int = 0
    residual_before: float = 0.0
    residual_after: float = 0.0
    _map: RowMap | None = dataclasses.field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, 'coefficients', _coefficients(self.coefficients))
        for name, low, high in (('width', 1, LARGEST_SIDE), ('height', 1, LARGEST_SIDE), ('points', 0, _MOST_POINTS)):
            value = getattr(self, name)
            if isinstance(value, bool) or not isinstance(value, int | np.integer) or not low <= value <= high:
                raise ValueError(f'{name} = {shown(value)} is not allowed: it must be an integer, {low} to {high}')
            object.__setattr__(self, name, int(value))
        for name in ('residual_before', 'residual_after'):
            value = getattr(self, name)
            if not _is_number(value) or value < 0:
                raise ValueError(f'{name} = {shown(value)} is not allowed: it must be a finite number of px, 0 or more')
            object.__setattr__(self, name, float(value))

    @classmethod
    def identity(cls, width: int, height: int) -> Self:
        """Of images whose rows are aligned: `apply` copies."""
        return cls((0.0,) * 6, width, height)

    @property
    def is_identity(self) -> bool:
        """Whether it moves nothing."""
        return not any(self.coefficients)

    def offsets(self, x: ArrayLike, y: ArrayLike) -> Float64:
        """dy, px, at columns x of the right image and rows y; of the shape that x and y have together."""
        u, v = _scaled(np.asarray(x, np.float64), np.asarray(y, np.float64), (self.height, self.width))
        c, cu, cv, cuv, cvv, cuu = self.coefficients
        return np.asarray((c + cv * v + cvv * v * v) + u * (cu + cuu * u + cuv * v))

    def places(self) -> dict[str, float]:
        """dy, px, at the centre and in the four corners of the image."""
        right, bottom = self.width - 1, self.height - 1
        where = {'centre': (right / 2, bottom / 2), 'top left': (0, 0), 'top right': (right, 0),
                 'bottom left': (0, bottom), 'bottom right': (right, bottom)}
        return {name: float(self.offsets(x, y)) for name, (x, y) in where.items()}

    def line(self) -> str:
        """What there is to be told of it, in one line."""
        offsets = ', '.join(f'{place} {dy:+.2f}' for place, dy in self.places().items())
        return (f'offsets of the right image in px: {offsets}; of {self.points} points the rms goes from '
                f'{self.residual_before:.2f} to {self.residual_after:.2f} px')

    def apply(self, right: Image) -> Image:
        """The right image with its rows as the left one's: R'(x, y) = R(x, y + dy), cubic, beyond the border as at it.

        right: uint8 or uint16, (height, width) or (height, width, 3); gives a new array of the same kind. Raises
        ValueError, in one line, where it has another size or dtype.
        """
        self._check(right)
        if self.is_identity:
            return right.copy()
        if self._map is None:  # made once; two threads would make the same
            object.__setattr__(self, '_map', row_map(self.offsets(*pixel_grid(self.height, self.width))))
        assert self._map is not None
        return resampled(right, self._map)

    def save(self, path: str | Path, force: bool = False) -> None:
        """Write it as YAML. Raises ValueError where the file exists (without `force`) or cannot be written."""
        write_outputs({Path(path): self.as_yaml().encode()}, force)

    def as_yaml(self) -> str:
        """What `save` writes and `load` reads."""
        return _COMMENT + yaml.safe_dump({_HEADING: self.as_dict()}, sort_keys=False)

    def as_dict(self) -> dict[str, Any]:
        """Plain values by name, for YAML and JSON."""
        return {field.name: list(value) if isinstance(value := getattr(self, field.name), tuple) else value
                for field in dataclasses.fields(self) if field.init}

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read what `save` wrote. Raises RefusedFileError (a ValueError), one line with the file and what is wrong."""
        document = read_yaml(Path(path), SETTINGS)
        try:
            return cls(**_values(document))
        except ValueError as error:
            raise RefusedFileError(f'{path}: {error}') from None

    def _check(self, right: Image) -> None:
        if not isinstance(right, np.ndarray) or right.dtype not in (np.uint8, np.uint16):
            told = f'dtype {right.dtype}' if isinstance(right, np.ndarray) else type(right).__name__
            raise ValueError(f'right image: {told} is not allowed: it must be an array of uint8 or uint16')
        if right.ndim not in (2, 3) or (right.ndim == 3 and right.shape[2] != 3):
            raise ValueError(f'right image: shape {right.shape} is not allowed: it must be (H, W) or (H, W, 3)')
        self.check_size(right.shape)

    def check_size(self, shape: tuple[int, ...]) -> None:
        """Raises ValueError, in one line, where images of `shape` have another size than this is for."""
        if shape[:2] != (self.height, self.width):
            raise ValueError(f'images of {shape[1]} x {shape[0]} px cannot be aligned by a row alignment for '
                             f'{self.width} x {self.height} px: estimate one for images of this size')


class RowPoints(NamedTuple):
    """Places where the vertical offset was measured: x_right, y, dy, float64 (N) each, px: what the left image has in
    row y, the right one has at (x_right, y + dy)."""

    x_right: Float64
    y: Float64
    dy: Float64

    @property
    def size(self) -> int:
        return int(self.dy.size)


NO_POINTS = RowPoints(*(np.zeros(0) for _ in range(3)))


def terms(x: NDArray[Any], y: NDArray[Any], shape: tuple[int, ...]) -> Float64:
    """TERMS at places of images of `shape`, along a new last axis."""
    u, v = _scaled(x, y, shape)
    return np.stack([np.ones_like(u), u, v, u * v, v * v, u * u], -1)


def _scaled(x: NDArray[Any], y: NDArray[Any], shape: tuple[int, ...]) -> tuple[Float64, Float64]:
    """u and v, about -1 .. 1, of columns x and rows y."""
    half_height, half_width = shape[0] / 2, shape[1] / 2
    return (x - half_width) / half_width, (y - half_height) / half_height


def pixel_grid(height: int, width: int) -> tuple[Float64, Float64]:
    """x (1, W) and y (H, 1) of all pixels."""
    return np.arange(width, dtype=np.float64)[None], np.arange(height, dtype=np.float64)[:, None]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float | np.floating) and not isinstance(value, bool) and math.isfinite(value)


def _coefficients(values: Any) -> tuple[float, ...]:
    wanted = (f'it must be {len(TERMS)} finite numbers of px, -{LARGEST_COEFFICIENT:g} to {LARGEST_COEFFICIENT:g}, '
              f'of {", ".join(TERMS)}')
    if not isinstance(values, list | tuple | np.ndarray) or len(values) != len(TERMS):
        raise ValueError(f'coefficients = {shown(values)} is not allowed: {wanted}')
    for value in values:
        if not _is_number(value) or abs(value) > LARGEST_COEFFICIENT:
            raise ValueError(f'coefficients: {shown(value)} is not allowed: {wanted}')
    return tuple(float(value) for value in values)


def _values(document: Any) -> dict[str, Any]:
    """The mapping below `row_alignment:`, with all names and no other."""
    names = [field.name for field in dataclasses.fields(RowAlignment) if field.init]
    inside = document.get(_HEADING) if isinstance(document, dict) and len(document) == 1 else None
    if not isinstance(inside, dict):
        raise ValueError(f"no row alignment: expected '{_HEADING}:' and below it {', '.join(names)}")
    for name in names:
        if name not in inside:
            raise ValueError(f'{name} is missing: write it anew with svdm check-rectification')
    for name in inside:
        if name not in names:
            raise ValueError(f'{shown(name)} is not known: there are {", ".join(names)}')
    return inside
