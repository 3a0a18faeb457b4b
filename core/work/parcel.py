"""What travels between machines as one piece of bytes: plain values and arrays, nothing that has to be unpickled."""

from __future__ import annotations

import io
import json
import zipfile
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import DermisError
from ..files import put_array, put_text
from ..foreign import json_of
from ..npz import ArrayFile
from .jobs import Arrays

HEAD = "head.json"
MAX_HEAD = 1 << 26  # bytes; a person's presets and a table's findings travel in it


def packed(head: Mapping[str, Any], arrays: Arrays) -> bytes:
    """Return plain values and arrays as bytes: an .npz with one text in it.

    Raises:
        DermisError: Python objects among the arrays.
    """
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", allowZip64=True) as archive:
        put_text(archive, HEAD, json.dumps(dict(head)))
        for name, array in arrays.items():
            put_array(archive, name, array)
    return file.getvalue()


def unpacked(data: bytes, where: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return the values and arrays that `packed` made bytes of.

    Args:
        where: name in errors.

    Raises:
        DermisError: it is something else, or damaged.
    """
    archive = ArrayFile(io.BytesIO(data), where, len(data), "a parcel of arrays")
    head = json_of(archive.text(HEAD, MAX_HEAD), where, MAX_HEAD, constants=True)
    if not isinstance(head, dict):
        raise DermisError("a parcel's head is one JSON object", where=where, value=type(head).__name__)
    return head, archive.arrays(archive.names)


def bytes_of(array: NDArray[Any]) -> bytes:
    """Return a file that travelled as an array."""
    return np.ascontiguousarray(array, np.uint8).tobytes()


def array_from(data: bytes) -> NDArray[np.uint8]:
    """Return a file as an array, to travel among others."""
    return np.frombuffer(data, np.uint8)
