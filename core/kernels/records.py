"""The records that kernels take.

Their fields are those of `kernels.h`, which describes them.
"""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from typing import Any

from numpy.typing import NDArray

ABI = 4
ROW, LANES, BOXES = (
    16,
    4,
    64,
)  # doubles per triangle in a tree; boxes or elements that are processed at once; floats for that many boxes
POSE = 32  # numbers of a pose, see `dermis_friction`
KEPT = 3  # largest number of earlier pairs of sweeps from which `dermis_sweep` extrapolates
DONE, BAD_RECORD, NOT_FINITE = 0, 1, 2
_data: Any = (ctypes.c_char * 0).from_buffer  # a fifth of the time of NumPy's `__array_interface__`


def address(array: NDArray[Any]) -> int:
    """Return the address of the data of a contiguous array.

    The array must exist as long as a record points to it.
    """
    try:
        return ctypes.addressof(_data(array))
    except TypeError:  # it is read-only
        return int(array.__array_interface__["data"][0])


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
        ("avx2", ctypes.c_int64),
        ("compliance", ctypes.c_void_p),
        ("offset", ctypes.c_void_p),
        ("normals", ctypes.c_void_p),
        ("friction", ctypes.c_void_p),
        ("softness", ctypes.c_void_p),
        ("tolerance", ctypes.c_double),
        ("most", ctypes.c_int64),
        ("force", ctypes.c_void_p),
        ("image", ctypes.c_void_p),
        ("moved", ctypes.c_void_p),
        ("status", ctypes.c_void_p),
        ("given", ctypes.c_int64),
        ("nodes", ctypes.c_void_p),
        ("room", ctypes.c_void_p),
        ("residual", ctypes.c_double),
        ("sweeps", ctypes.c_int64),
        ("missed", ctypes.c_int64),
        ("wrong", ctypes.c_int64),
    ]


class PosedRecord(ctypes.Structure):
    """`dermis_posed`."""

    _fields_ = [
        ("body", ctypes.c_void_p),
        ("plane", ctypes.c_double * 4),
        ("rotation", ctypes.c_double * 9),
        ("translation", ctypes.c_double * 3),
        ("friction", ctypes.c_double),
        ("softness", ctypes.c_double),
        ("side", ctypes.c_double),
    ]


class SurveyRecord(ctypes.Structure):
    """`dermis_survey`."""

    _fields_ = [
        ("bodies", ctypes.c_int64),
        ("posed", ctypes.c_void_p),
        ("limit", ctypes.c_double),
        ("roots", ctypes.c_int64),
        ("levels", ctypes.c_int64),
        ("squares", ctypes.c_int64),
        ("first", ctypes.c_void_p),
        ("ways", ctypes.c_void_p),
        ("root", ctypes.c_void_p),
        ("halved", ctypes.c_void_p),
        ("place", ctypes.c_void_p),
        ("quarters", ctypes.c_void_p),
        ("positions", ctypes.c_void_p),
        ("normals", ctypes.c_void_p),
        ("sides", ctypes.c_void_p),
        ("limits", ctypes.c_void_p),
        ("longs", ctypes.c_void_p),
        ("ways_before", ctypes.c_void_p),
        ("points", ctypes.c_int64),
        ("owner", ctypes.c_void_p),
        ("in_root", ctypes.c_void_p),
        ("raised", ctypes.c_void_p),
        ("loaded", ctypes.c_int64),
        ("load", ctypes.c_void_p),
        ("rows", ctypes.c_void_p),
        ("filled", ctypes.c_int64),
        ("table", ctypes.c_void_p),
        ("common", ctypes.c_double * 3),
        ("turned", ctypes.c_double),
        ("edge", ctypes.c_double),
        ("sharp", ctypes.c_double),
        ("bent", ctypes.c_double),
        ("corners", ctypes.c_double),
        ("beyond", ctypes.c_double),
        ("beside", ctypes.c_double),
        ("merge", ctypes.c_double),
        ("odd", ctypes.c_double),
        ("level", ctypes.c_double),
        ("deep", ctypes.c_double),
        ("steep", ctypes.c_double),
        ("often", ctypes.c_int64),
        ("coarsest", ctypes.c_int64),
        ("many", ctypes.c_int64),
        ("thorough", ctypes.c_int64),
        ("most", ctypes.c_int64),
        ("room", ctypes.c_void_p),
        ("afar", ctypes.c_void_p),
        ("finest", ctypes.c_int64),
        ("found", ctypes.c_int64),
        ("cut", ctypes.c_int64),
        ("edges", ctypes.c_int64),
        ("leaves", ctypes.c_void_p),
        ("clearance", ctypes.c_void_p),
        ("cuts", ctypes.c_void_p),
        ("cut_ways", ctypes.c_void_p),
    ]


class LawRecord(ctypes.Structure):
    """`dermis_law`."""

    _fields_ = [
        ("nodes", ctypes.c_int64),
        ("elements", ctypes.c_int64),
        ("corners", ctypes.c_void_p),
        ("slopes", ctypes.c_void_p),
        ("volumes", ctypes.c_void_p),
        ("around", ctypes.c_void_p),
        ("first", ctypes.c_double),
        ("shear", ctypes.c_double),
        ("least", ctypes.c_double),
        ("moved", ctypes.c_void_p),
        ("room", ctypes.c_void_p),
        ("force", ctypes.c_void_p),
        ("stress", ctypes.c_void_p),
        ("stored", ctypes.c_int64),
        ("energy", ctypes.c_double),
        ("flattest", ctypes.c_double),
    ]


class RestRecord(ctypes.Structure):
    """`dermis_rest`."""

    _fields_ = [
        ("size", ctypes.c_int64),
        ("levels", ctypes.c_int64),
        ("starts", ctypes.c_void_p),
        ("order", ctypes.c_void_p),
        ("numbers", ctypes.c_int64),
        ("inverses", ctypes.c_void_p),
        ("diagonals", ctypes.c_void_p),
        ("couplings", ctypes.c_int64),
        ("rows", ctypes.c_void_p),
        ("columns", ctypes.c_void_p),
        ("values", ctypes.c_void_p),
        ("force", ctypes.c_void_p),
        ("moved", ctypes.c_void_p),
        ("room", ctypes.c_void_p),
    ]


class PatchesRecord(ctypes.Structure):
    """`dermis_patches`."""

    _fields_ = [
        ("count", ctypes.c_int64),
        ("positions", ctypes.c_void_p),
        ("normals", ctypes.c_void_p),
        ("sides", ctypes.c_void_p),
        ("areas", ctypes.c_void_p),
    ]


class PiecesRecord(ctypes.Structure):
    """`dermis_pieces`."""

    _fields_ = [
        ("field", ctypes.c_void_p),
        ("source", ctypes.c_void_p),
        ("poisson", ctypes.c_double),
        ("single", ctypes.c_int64),
        ("out", ctypes.c_void_p),
    ]


class PointsRecord(ctypes.Structure):
    """`dermis_points`."""

    _fields_ = [
        ("known", ctypes.c_int64),
        ("side", ctypes.c_int64),
        ("root", ctypes.c_void_p),
        ("halved", ctypes.c_void_p),
        ("place", ctypes.c_void_p),
        ("around", ctypes.c_void_p),
        ("before", ctypes.c_int64),
        ("old_cells", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("cells", ctypes.c_void_p),
        ("owner", ctypes.c_void_p),
        ("in_root", ctypes.c_void_p),
        ("number", ctypes.c_void_p),
        ("beside", ctypes.c_void_p),
    ]


class DrawnRecord(ctypes.Structure):
    """`dermis_drawn`."""

    _fields_ = [
        ("nodes", ctypes.c_int64),
        ("triangles", ctypes.c_int64),
        ("points", ctypes.c_void_p),
        ("corners", ctypes.c_void_p),
        ("drawn", ctypes.c_int64),
        ("entries", ctypes.c_int64),
        ("rest", ctypes.c_void_p),
        ("starts", ctypes.c_void_p),
        ("columns", ctypes.c_void_p),
        ("weights", ctypes.c_void_p),
        ("pad", ctypes.c_int64),
        ("pad_positions", ctypes.c_void_p),
        ("pad_normals", ctypes.c_void_p),
        ("force", ctypes.c_void_p),
        ("normal_force", ctypes.c_double),
        ("table", ctypes.c_void_p),
        ("modulus", ctypes.c_double),
        ("quantity", ctypes.c_int64),
        ("exaggeration", ctypes.c_double),
        ("lift", ctypes.c_double),
        ("moved", ctypes.c_void_p),
        ("values", ctypes.c_void_p),
        ("sums", ctypes.c_void_p),
        ("room", ctypes.c_void_p),
        ("positions", ctypes.c_void_p),
        ("normals", ctypes.c_void_p),
        ("shown", ctypes.c_void_p),
        ("low", ctypes.c_double),
        ("high", ctypes.c_double),
        ("centre", ctypes.c_double * 2),
        ("shear", ctypes.c_double * 2),
    ]


class GapsRecord(ctypes.Structure):
    """`dermis_gaps`."""

    _fields_ = [
        ("body", ctypes.c_void_p),
        ("pose", ctypes.c_void_p),
        ("box", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("index", ctypes.c_int64),
        ("radius", ctypes.c_double),
        ("side", ctypes.c_double),
        ("friction", ctypes.c_double),
        ("softness", ctypes.c_double),
        ("points", ctypes.c_void_p),
        ("places", ctypes.c_void_p),
        ("came", ctypes.c_void_p),
        ("before", ctypes.c_void_p),
        ("told", ctypes.c_void_p),
        ("which", ctypes.c_void_p),
        ("met", ctypes.c_int64),
        ("turned", ctypes.c_int64),
        ("wrong", ctypes.c_int64),
    ]


class FrictionRecord(ctypes.Structure):
    """`dermis_friction`."""

    _fields_ = [
        ("count", ctypes.c_int64),
        ("bodies", ctypes.c_int64),
        ("poses", ctypes.c_void_p),
        ("owner", ctypes.c_void_p),
        ("material", ctypes.c_void_p),
        ("normal", ctypes.c_void_p),
        ("gap", ctypes.c_void_p),
        ("slip", ctypes.c_void_p),
        ("swept", ctypes.c_void_p),
        ("triangle", ctypes.c_void_p),
        ("corners", ctypes.c_void_p),
        ("sticking", ctypes.c_void_p),
        ("anchors", ctypes.c_void_p),
        ("normals", ctypes.c_void_p),
        ("points", ctypes.c_void_p),
        ("image", ctypes.c_void_p),
        ("radius", ctypes.c_double),
        ("force", ctypes.c_void_p),
        ("drift", ctypes.c_double * 3),
        ("passed", ctypes.c_double * 3),
        ("places", ctypes.c_void_p),
        ("origins", ctypes.c_void_p),
        ("below", ctypes.c_void_p),
        ("faces", ctypes.c_void_p),
        ("facing", ctypes.c_void_p),
        ("gaps", ctypes.c_void_p),
        ("friction", ctypes.c_void_p),
        ("own", ctypes.c_void_p),
        ("soft", ctypes.c_void_p),
        ("loaded", ctypes.c_void_p),
        ("share", ctypes.c_double),
        ("offset", ctypes.c_void_p),
        ("sweeping", ctypes.c_void_p),
        ("shifted", ctypes.c_int64),
        ("entered", ctypes.c_int64),
        ("nodes", ctypes.c_void_p),
        ("shift", ctypes.c_void_p),
        ("entering", ctypes.c_void_p),
        ("crossing", ctypes.c_void_p),
        ("moved", ctypes.c_void_p),
        ("status", ctypes.c_void_p),
        ("positions", ctypes.c_void_p),
        ("renewed", ctypes.c_void_p),
        ("slides", ctypes.c_int64),
    ]


class SumsRecord(ctypes.Structure):
    """`dermis_sums`."""

    _fields_ = [
        ("count", ctypes.c_int64),
        ("from_rest", ctypes.c_int64),
        ("points", ctypes.c_void_p),
        ("force", ctypes.c_void_p),
        ("normals", ctypes.c_void_p),
        ("displacement", ctypes.c_void_p),
        ("image", ctypes.c_void_p),
        ("gaps", ctypes.c_void_p),
        ("status", ctypes.c_void_p),
        ("bone", ctypes.c_double * 3),
        ("normal", ctypes.c_double),
        ("tangential", ctypes.c_double),
        ("depth", ctypes.c_double),
        ("slide", ctypes.c_double),
        ("sticking", ctypes.c_int64),
        ("slipping", ctypes.c_int64),
    ]


# The records and their names in C, in the order of the layout.
class DiscRecord(ctypes.Structure):
    """`dermis_disc`."""

    _fields_ = [
        ("points", ctypes.c_int64),
        ("positions", ctypes.c_void_p),
        ("places", ctypes.c_void_p),
        ("anchors", ctypes.c_void_p),
        ("anchored", ctypes.c_void_p),
        ("sticking", ctypes.c_void_p),
        ("radius", ctypes.c_double),
        ("rounding", ctypes.c_double),
        ("friction", ctypes.c_double),
        ("weight", ctypes.c_double),
        ("margin", ctypes.c_double),
        ("tolerance", ctypes.c_double),
        ("most", ctypes.c_int64),
        ("freedoms", ctypes.c_int64),
        ("turning", ctypes.c_int64),
        ("pose", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("near", ctypes.c_void_p),
        ("compliance", ctypes.c_void_p),
        ("less", ctypes.c_void_p),
        ("leading", ctypes.c_int64),
        ("told", ctypes.c_void_p),
        ("room", ctypes.c_void_p),
        ("indices", ctypes.c_void_p),
        ("gap", ctypes.c_void_p),
        ("strays", ctypes.c_int64),
        ("touching", ctypes.c_int64),
        ("answer", ctypes.c_void_p),
        ("moved", ctypes.c_void_p),
        ("offset", ctypes.c_void_p),
        ("status", ctypes.c_void_p),
        ("residual", ctypes.c_double),
        ("steps", ctypes.c_int64),
        ("wrong", ctypes.c_int64),
    ]


class SettledRecord(ctypes.Structure):
    """`dermis_settled`."""

    _fields_ = [
        ("points", ctypes.c_int64),
        ("positions", ctypes.c_void_p),
        ("anchors", ctypes.c_void_p),
        ("anchored", ctypes.c_void_p),
        ("compliance", ctypes.c_void_p),
        ("less", ctypes.c_void_p),
        ("pose", ctypes.c_void_p),
        ("count", ctypes.c_int64),
        ("near", ctypes.c_void_p),
        ("width", ctypes.c_int64),
        ("answer", ctypes.c_void_p),
        ("status", ctypes.c_void_p),
        ("moved", ctypes.c_void_p),
        ("force", ctypes.c_void_p),
        ("anchor", ctypes.c_void_p),
        ("sticks", ctypes.c_void_p),
        ("wrong", ctypes.c_int64),
    ]


# The records and their names in C, in the order of the layout.
RECORDS: tuple[tuple[str, type[ctypes.Structure]], ...] = (
    ("tree", TreeRecord),
    ("body", BodyRecord),
    ("query", QueryRecord),
    ("contact", ContactRecord),
    ("posed", PosedRecord),
    ("survey", SurveyRecord),
    ("law", LawRecord),
    ("rest", RestRecord),
    ("patches", PatchesRecord),
    ("pieces", PiecesRecord),
    ("points", PointsRecord),
    ("drawn", DrawnRecord),
    ("gaps", GapsRecord),
    ("friction", FrictionRecord),
    ("sums", SumsRecord),
    ("disc", DiscRecord),
    ("settled", SettledRecord),
)


def layout() -> Iterator[int]:
    """Yield the numbers that `dermis_layout` of a fitting library returns."""
    yield from (ABI, ROW, LANES, BOXES, KEPT)
    for _, record in RECORDS:
        yield ctypes.sizeof(record)
        yield from (getattr(record, field[0]).offset for field in record._fields_)
    yield 2**64 - 1


def fields() -> str:
    """Return the string that `dermis_fields` of a fitting library returns."""
    return " ".join(word for kind, record in RECORDS for word in (kind, *(field[0] for field in record._fields_)))
