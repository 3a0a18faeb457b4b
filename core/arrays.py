"""What arrays of numbers are called in annotations, and their hash; shapes and units stand in docstrings."""

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
    """Add whole arrays with their types and shapes to a hash."""
    for array in arrays:
        sha.update(f"{array.dtype.str}{array.shape}".encode())
        sha.update(np.ascontiguousarray(array).data)
