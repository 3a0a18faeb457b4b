"""Parcels: plain values and arrays as one piece of bytes.

They are sent between machines without pickle.
"""

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
MAX_HEAD = 1 << 26  # [bytes] largest size of the plain values; among them are presets and a table's findings


def packed(head: Mapping[str, Any], arrays: Arrays) -> bytes:
    """Return plain values and arrays as bytes.

    The bytes are an .npz file that also contains a JSON text.

    Raises:
        DermisError: an array contains Python objects.
    """
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", allowZip64=True) as archive:
        put_text(archive, HEAD, json.dumps(dict(head)))
        for name, array in arrays.items():
            put_array(archive, name, array)
    return file.getvalue()


def unpacked(data: bytes, where: str) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return values and arrays from bytes; the inverse of `packed`.

    Args:
        data: the bytes.
        where: name for errors.

    Raises:
        DermisError: the bytes are not a parcel, or are damaged.
    """
    archive = ArrayFile(io.BytesIO(data), where, len(data), "a parcel of arrays")
    head = json_of(archive.text(HEAD, MAX_HEAD), where, MAX_HEAD, constants=True)
    if not isinstance(head, dict):
        raise DermisError("a parcel's head is one JSON object", where=where, value=type(head).__name__)
    return head, archive.arrays(archive.names)


def bytes_of(array: NDArray[Any]) -> bytes:
    """Return the bytes of a file that was sent as an array."""
    return np.ascontiguousarray(array, np.uint8).tobytes()


def array_from(data: bytes) -> NDArray[np.uint8]:
    """Return the bytes of a file as an array, to be sent among other arrays."""
    return np.frombuffer(data, np.uint8)
