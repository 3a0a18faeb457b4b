"""The records that kernels take, field by field as `kernels.h` has them."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator

ABI = 2
ROW, LANES, BOXES = (
    16,
    4,
    64,
)  # doubles of a triangle in a tree; boxes that are looked at at once, and floats of so many
KEPT = 3  # pairs of sweeps that are remembered
DONE, BAD_RECORD, NOT_FINITE = 0, 1, 2


class TreeRecord(ctypes.Structure):
    """`dermis_tree`."""

    _fields_ = [
        ("total", ctypes.c_int64),
        ("count", ctypes.c_int64),
        ("depth", ctypes.c_int64),
        ("rows", ctypes.c_void_p),
        ("bounds", ctypes.c_void_p),
        ("slivers", ctypes.c_void_p),
        ("order", ctypes.c_void_p),
        ("packed", ctypes.c_void_p),
        ("boxes", ctypes.c_void_p),
        ("middle", ctypes.c_double * 3),
        ("scale", ctypes.c_double),
        ("largest", ctypes.c_double),
        ("wrong", ctypes.c_int64),
    ]


class BodyRecord(ctypes.Structure):
    """`dermis_body`."""

    _fields_ = [
        ("next", ctypes.c_void_p),
        ("tree", ctypes.c_void_p),
        ("all", ctypes.c_void_p),
        ("vertices", ctypes.c_int64),
        ("closed", ctypes.c_int64),
        ("by_rays", ctypes.c_int64),
        ("outside", ctypes.c_int64),
        ("parts", ctypes.c_int64),
        ("slabs", ctypes.c_int64),
        ("weld", ctypes.c_double),
        ("corners", ctypes.c_void_p),
        ("across", ctypes.c_void_p),
        ("edge_kind", ctypes.c_void_p),
        ("vertex_kind", ctypes.c_void_p),
        ("part", ctypes.c_void_p),
        ("slab", ctypes.c_void_p),
        ("normals", ctypes.c_void_p),
    ]


class QueryRecord(ctypes.Structure):
    """`dermis_query`."""

    _fields_ = [
        ("body", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("limit", ctypes.c_double),
        ("points", ctypes.c_void_p),
        ("gap", ctypes.c_void_p),
        ("normal", ctypes.c_void_p),
        ("closest", ctypes.c_void_p),
        ("weights", ctypes.c_void_p),
        ("triangle", ctypes.c_void_p),
        ("feature", ctypes.c_void_p),
        ("beside", ctypes.c_void_p),
        ("wrong", ctypes.c_int64),
    ]


class ContactRecord(ctypes.Structure):
    """`dermis_contact`."""

    _fields_ = [
        ("count", ctypes.c_int64),
        ("single", ctypes.c_int64),
        ("stride", ctypes.c_int64),
        ("compliance", ctypes.c_void_p),
        ("offset", ctypes.c_void_p),
        ("normals", ctypes.c_void_p),
        ("friction", ctypes.c_void_p),
        ("softness", ctypes.c_void_p),
        ("tolerance", ctypes.c_double),
        ("most", ctypes.c_int64),
        ("force", ctypes.c_void_p),
        ("image", ctypes.c_void_p),
        ("given", ctypes.c_int64),
        ("nodes", ctypes.c_void_p),
        ("room", ctypes.c_void_p),
        ("residual", ctypes.c_double),
        ("sweeps", ctypes.c_int64),
        ("wrong", ctypes.c_int64),
    ]


def layout() -> Iterator[int]:
    """Yield what `dermis_layout` returns of a library that fits."""
    yield from (ABI, ROW, LANES, BOXES, KEPT)
    for record in (TreeRecord, BodyRecord, QueryRecord, ContactRecord):
        yield ctypes.sizeof(record)
        yield from (getattr(record, field[0]).offset for field in record._fields_)
    yield 2**64 - 1


def fields() -> str:
    """Return what `dermis_fields` returns of a library that fits."""
    records = (("tree", TreeRecord), ("body", BodyRecord), ("query", QueryRecord), ("contact", ContactRecord))
    return " ".join(word for kind, record in records for word in (kind, *(field[0] for field in record._fields_)))
