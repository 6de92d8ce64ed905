"""Names for the arrays that go from stage to stage. Shapes stand in the docstrings."""
from typing import Any

import numpy as np
from numpy.typing import DTypeLike, NDArray

_CACHE_LINE = 64  # bytes

Image = NDArray[Any]  # uint8 or uint16, (H, W) grey or (H, W, 3) BGR
Bool = NDArray[np.bool_]
Uint8 = NDArray[np.uint8]
Uint16 = NDArray[np.uint16]
Int16 = NDArray[np.int16]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
UInt64 = NDArray[np.uint64]
Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]


def aligned_zeros(shape: tuple[int, ...], dtype: DTypeLike) -> NDArray[Any]:
    """Zeros that begin with a cache line, so that no vector of one line lies across two."""
    size = int(np.prod(shape)) * np.dtype(dtype).itemsize
    memory = np.zeros(size + _CACHE_LINE, np.uint8)
    start = -memory.ctypes.data % _CACHE_LINE
    return memory[start:start + size].view(dtype).reshape(shape)
