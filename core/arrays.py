"""Types of arrays for annotations, and a hash of arrays.

The types state no shapes and units; docstrings do.
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Floats32 = NDArray[np.float32]
Floats = NDArray[np.floating[Any]]
Indices = NDArray[np.int64]
Indices32 = NDArray[np.int32]


def feed(sha: Any, *arrays: NDArray[Any]) -> None:
    """Add arrays, with their types and shapes, to a hash object of `hashlib`."""
    for array in arrays:
        sha.update(f"{array.dtype.str}{array.shape}".encode())
        sha.update(np.ascontiguousarray(array).data)
