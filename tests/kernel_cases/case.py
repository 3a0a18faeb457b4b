"""Arrays for functions of a library of kernels, called with any library and any numbers."""

from __future__ import annotations

import ctypes
from collections.abc import Iterator
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from core.arrays import Array
from core.kernels import building, records

TYPES = {"double": "f8", "float": "f4"} | {f"{kind}_t": kind for kind in ("int64", "int32", "int16", "int8", "uint8")}
WORKSPACES = "room", "sums", "work", "indices"  # nobody reads them after a call
SIZES: dict[int, int] = {}  # bytes of an array, by where it begins: a call in another process sends them there
Record = TypeVar("Record", bound=ctypes.Structure)


def address(array: Array) -> int:
    """Return where an array begins, and note how long it is."""
    found = int(array.ctypes.data)
    SIZES[found] = array.nbytes
    return found


def declared(record: type[ctypes.Structure] | ctypes.Structure) -> list[building.Field]:
    """Return the fields of a record."""
    kind = record if isinstance(record, type) else type(record)
    return next(records.HEADER.records[name] for name, own in records.RECORDS.items() if own is kind)


def filled(kind: type[Record], *owners: object, **values: Any) -> Record:
    """Return a record that points to arrays of the types that `kernels.h` declares, and keeps them.

    Args:
        owners: objects whose attributes are the fields that are not among the values.
        values: arrays, records and numbers.
    """
    record, kept = kind(), dict[str, Any]()
    for field in declared(kind):
        found = next((getattr(owner, field.name) for owner in owners if hasattr(owner, field.name)), None)
        value = values.pop(field.name, found)
        if isinstance(value, np.ndarray) and field.type.endswith("*"):
            wanted = TYPES.get(field.type.split()[-2], value.dtype.str)
            assert np.dtype(value.dtype.str.replace("b", "u")) == np.dtype(wanted), (field, value.dtype)
            assert value.flags.c_contiguous, field
            kept[field.name], value = value, address(value)
        elif isinstance(value, ctypes.Structure | ctypes.Array):
            kept[field.name], value = value, ctypes.addressof(value)
            SIZES[value] = ctypes.sizeof(kept[field.name])
        if value is not None:
            setattr(record, field.name, tuple(np.ravel(value).tolist()) if field.length > 1 else value)
    assert not values, values
    record.kept = kept
    return record


class Case:
    """Arrays for functions of a library, which gets every change that is made before a call.

    Attributes:
        results: names of the numbers that a call has found, in any of its records.
        called: records of the last call, the main one first.
    """

    results: tuple[str, ...] = ()
    called: list[Any]

    def call(self, own: Any, **changed: float | None) -> list[int]:
        """Return the statuses of all functions, with fields of the main record changed; the results stay."""
        self.called = []
        return list(self._calls(own, **changed))

    def _calls(self, own: Any, **changed: float | None) -> Iterator[int]:
        """Call the functions of this case one after the other."""
        raise NotImplementedError

    def _call(self, function: Any, record: ctypes.Structure, **changed: float | None) -> int:
        """Return the status of a call."""
        if record not in self.called:
            self.called.append(record)
        for name, value in changed.items():
            setattr(record, name, value)
        return int(function(ctypes.byref(record)))

    @property
    def record(self) -> Any:
        """The main record of the last call."""
        return self.called[0]

    def answer(self) -> bytes:
        """Return everything that the last call has found."""
        found = list[Any]()
        for record in self.called:
            for field in declared(record):
                if not field.type.endswith("*"):
                    found += [getattr(record, field.name)] * (field.name in self.results)
                elif not field.type.startswith("const") and field.name not in WORKSPACES:
                    kept = record.kept.get(field.name, ())
                    found.append(() if isinstance(kept, ctypes.Structure) else kept)
        return b"".join(np.asarray(one).tobytes() for one in found)


def opened(path: Path) -> ctypes.CDLL:
    """Load a library of kernels as it is."""
    library = ctypes.CDLL(str(path))
    for name in records.HEADER.functions:
        getattr(library, name).argtypes = (ctypes.c_void_p,)
    return library


def gcc(out: Path, *flags: str) -> list[str]:
    """Return the command by which gcc makes a library of the sources, and of others among the flags."""
    made = out.with_name("described.c")
    made.write_text(building.described())
    files = [str(path) for path in (*building.sources(), made) if path.suffix == ".c"]
    return ["gcc", *building.FLAGS, "-fPIC", f"-I{building.FOLDER}", *flags, "-o", str(out), *files]
