"""Names for the arrays that go from stage to stage. Shapes stand in the docstrings."""
from typing import Any

import numpy as np
from numpy.typing import NDArray

Image = NDArray[Any]  # uint8 or uint16, (H, W) grey or (H, W, 3) BGR
Bool = NDArray[np.bool_]
Uint8 = NDArray[np.uint8]
Uint16 = NDArray[np.uint16]
Int16 = NDArray[np.int16]
Int32 = NDArray[np.int32]
Int64 = NDArray[np.int64]
UInt64 = NDArray[np.uint64]
Float32 = NDArray[np.float32]
