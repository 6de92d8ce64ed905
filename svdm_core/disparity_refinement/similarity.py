"""How alike two pixels of the guide are: the exponential of eq 17 in 16 bits."""
from __future__ import annotations

from typing import Any

import numpy as np

from ..kernels.arrays import Uint16
from ..kernels.compilation import kernel
from ..kernels.instructions import multiply_high
from ..kernels.wide import Lanes, minimum_wide, shift_right, splat_wide, subtract_saturated


def slope_of(sigma_c: float) -> np.uint16:
    """What `similarity` takes for a reach of sigma_c, guide on 0..1."""
    return np.uint16(min(round(65536 * 256 / (64 * (255 * sigma_c) ** 2)), 65535))


@kernel(inline=True)
def similarity(squares: Uint16, slope: np.uint16, lanes: Lanes) -> Any:
    """65535 exp(-squares / (255 sigma_c)^2) as uint16 lanes; squares: sums of squared differences of grey levels.

    It is (1 - x / 64)^64, squared six times.
    """
    share = subtract_saturated(splat_wide(np.uint16(65535), lanes), _sixty_fourth(squares, slope, lanes))
    for _ in range(6):
        share = multiply_high(share, share)
    return share


@kernel(inline=True)
def _sixty_fourth(squares: Uint16, slope: np.uint16, lanes: Lanes) -> Any:
    """squares * slope / 256, about 65535 where it does not fit."""
    factor = splat_wide(slope, lanes)
    high = minimum_wide(multiply_high(squares, factor), splat_wide(np.uint16(255), lanes))
    return high * splat_wide(np.uint16(256), lanes) + shift_right(squares * factor, 8)
