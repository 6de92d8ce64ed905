"""What the benchmarks can run at all: refused before the work, not by OpenCV or by the lack of memory in the middle."""
from __future__ import annotations

from ..memory import in_gigabytes
from ..runtime.free_memory import free_memory

_STEP = 16  # OpenCV rounds disparities up to a multiple of it, and StereoBM takes no image smaller than its block of 15
_VOLUME_BYTES = 4  # a pixel and disparity: two volumes of 16 bits, of SGBM HH, the most that a contender takes
_PIXEL_BYTES = 200  # planes, trees, and what else does not depend on the disparities


def check_limits(width: int, height: int, num_disparities: int) -> None:
    """Raises ValueError where the images are too small for the disparities, or too large for the memory."""
    least = smallest_width(num_disparities)
    if width < least or height < _STEP:
        raise ValueError(f'size {width}x{height} is not allowed: OpenCV needs {least}x{_STEP} px or more for '
                         f'{num_disparities} disparities: take larger images or fewer disparities')
    check_memory(width, height, num_disparities)


def check_memory(width: int, height: int, num_disparities: int) -> None:
    """Raises ValueError where images of this size take more memory than is free."""
    needed = width * height * (_VOLUME_BYTES * num_disparities + _PIXEL_BYTES)
    free = free_memory()
    if free is not None and needed > free:
        raise ValueError(f'size {width}x{height} with {num_disparities} disparities needs about '
                         f'{in_gigabytes(needed)}, and {in_gigabytes(free)} are free: take smaller images or fewer '
                         'disparities')


def smallest_width(num_disparities: int) -> int:
    """The narrowest image that all of OpenCV's matchers take (SGBM crashes below)."""
    return (-(-num_disparities // _STEP) + 1) * _STEP
