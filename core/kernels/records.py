"""The records that kernels take.

They are made from `kernels.h`, which describes them, and need no library: devices without a skin do without it. The
loader compares their layout with that of the library.
"""

from __future__ import annotations

import ctypes
from typing import Any, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

from . import building

HEADER = building.declared()
ROW, LANES, BOXES, POSE = (HEADER.constants[name] for name in ("ROW", "LANES", "BOXES", "POSE"))
FOUND, TOUCH_ROOM, SWEEP_ROOM = (HEADER.constants[name] for name in ("FOUND", "TOUCH_ROOM", "SWEEP_ROOM"))
DONE, BAD_RECORD, NOT_FINITE, ASKS = (HEADER.constants[name] for name in ("DONE", "BAD_RECORD", "NOT_FINITE", "ASKS"))
RECORDS: dict[str, type[ctypes.Structure]] = {}  # by their names in C without the prefix 'dermis_'
_data: Any = (ctypes.c_char * 0).from_buffer  # a fifth of the time of NumPy's `__array_interface__`


def address(array: NDArray[Any]) -> int:
    """Return the address of the data of a contiguous array.

    The array must exist as long as a record points to it.
    """
    try:
        return ctypes.addressof(_data(array))
    except TypeError:  # it is read-only
        return int(array.__array_interface__["data"][0])


def numbers_of(record: ctypes.Structure) -> NDArray[np.float64]:
    """Return the memory of a record as numbers, of which only those at a `place_of` a field have a meaning.

    Arrays of numbers are read and written faster than a record's own fields.
    """
    return np.frombuffer(cast(Any, record))


def place_of(record: type[ctypes.Structure], name: str) -> slice:
    """Return the place of a field of doubles in `numbers_of` a record."""
    field = getattr(record, name)
    return slice(field.offset // 8, (field.offset + field.size) // 8)


def layout() -> str:
    """Return the string that `dermis_layout` of a fitting library returns."""
    values = {f"DERMIS_{name}": value for name, value in HEADER.constants.items()}
    for name, record in RECORDS.items():
        values[f"sizeof(dermis_{name})"] = ctypes.sizeof(record)
        for field in HEADER.records[name]:
            values[f"offsetof(dermis_{name}, {field.name})"] = getattr(record, field.name).offset
    return building.of_layout(values)


Record = TypeVar("Record", bound=type[ctypes.Structure])


def _declared(record: Record) -> Record:
    """Give a record the fields that `kernels.h` declares."""
    name = record.__name__.removesuffix("Record").lower()
    record._fields_ = [(field.name, _of_field(field)) for field in HEADER.records[name]]
    RECORDS[name] = record
    return record


def _of_field(field: building.Field) -> Any:
    if field.type.endswith("*"):
        return ctypes.c_void_p
    number: Any = {"int64_t": ctypes.c_int64, "double": ctypes.c_double}[field.type]
    return number if field.length == 1 else number * field.length


@_declared
class TreeRecord(ctypes.Structure):
    """`dermis_tree`."""


@_declared
class ConvexRecord(ctypes.Structure):
    """`dermis_convex`."""


@_declared
class BodyRecord(ctypes.Structure):
    """`dermis_body`."""


@_declared
class QueryRecord(ctypes.Structure):
    """`dermis_query`."""


@_declared
class ContactRecord(ctypes.Structure):
    """`dermis_contact`."""


@_declared
class PosedRecord(ctypes.Structure):
    """`dermis_posed`."""


@_declared
class TouchRecord(ctypes.Structure):
    """`dermis_touch`."""


@_declared
class SurveyRecord(ctypes.Structure):
    """`dermis_survey`."""


@_declared
class LawRecord(ctypes.Structure):
    """`dermis_law`."""


@_declared
class RestRecord(ctypes.Structure):
    """`dermis_rest`."""


@_declared
class PatchesRecord(ctypes.Structure):
    """`dermis_patches`, with the arrays to which it points."""

    kept: list[NDArray[Any]]


@_declared
class PiecesRecord(ctypes.Structure):
    """`dermis_pieces`."""


@_declared
class DrawnRecord(ctypes.Structure):
    """`dermis_drawn`."""


@_declared
class FrictionRecord(ctypes.Structure):
    """`dermis_friction`."""


@_declared
class SumsRecord(ctypes.Structure):
    """`dermis_sums`."""


@_declared
class DiscRecord(ctypes.Structure):
    """`dermis_disc`."""


@_declared
class SettledRecord(ctypes.Structure):
    """`dermis_settled`."""


@_declared
class ThimbleRecord(ctypes.Structure):
    """`dermis_thimble`."""


@_declared
class SearchRecord(ctypes.Structure):
    """`dermis_search`."""


@_declared
class CellsRecord(ctypes.Structure):
    """`dermis_cells`."""


@_declared
class MovesRecord(ctypes.Structure):
    """`dermis_moves`."""


@_declared
class HeirsRecord(ctypes.Structure):
    """`dermis_heirs`."""


@_declared
class StatesRecord(ctypes.Structure):
    """`dermis_states`."""


@_declared
class ArrivalsRecord(ctypes.Structure):
    """`dermis_arrivals`."""
